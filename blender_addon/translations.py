"""The add-on's words and tooltips in other languages: catalogs of gettext in ``locale/``, which translators edit.

Blender shows its own translation of a word where it has one. Where that has another sense, the word is looked up in a
context of its own. What a catalog lacks stays English.
"""

import gettext
from io import BytesIO
from pathlib import Path

import bpy

from .manual import operators
from .preferences import PACKAGE
from .settings.messages import OWN_SENSE, store_sentences

LOCALE = Path(__file__).parent / "locale"

# Blender looks for the names of operators in a context of their own.
_CONTEXTS = ("*", "Operator", OWN_SENSE)


def messages(language: str) -> dict[str, str]:
    """A language's messages by the English ones.

    The extension holds compiled catalogs. A checkout does not: there Babel compiles them, and without Babel everything
    stays English.
    """
    catalog = LOCALE / f"{language}.mo"
    if catalog.is_file():
        compiled = BytesIO(catalog.read_bytes())
    else:
        try:
            from babel.messages import mofile, pofile
        except ImportError:
            return {}
        compiled = BytesIO()
        mofile.write_mo(compiled, pofile.read_po(BytesIO(catalog.with_suffix(".po").read_bytes())))
        compiled.seek(0)
    found = vars(gettext.GNUTranslations(compiled))["_catalog"]  # gettext has no public way to list the messages
    return {english: word for english, word in found.items() if english}


def one_line(tooltip: str) -> str:
    """A tooltip as a catalog has it: how Blender breaks and indents an operator's docstring depends on the Python."""
    return " ".join(tooltip.split())


def register() -> None:
    tips = {rna.description: one_line(rna.description) for _, rna in operators()}
    tables = {}
    for language in {path.stem for path in LOCALE.glob("*.[mp]o")}:
        found = messages(language)
        store_sentences(language, found)
        found |= {tip: found[line] for tip, line in tips.items() if line in found}
        tables[language] = {(context, english): word for context in _CONTEXTS for english, word in found.items()}
    bpy.app.translations.register(PACKAGE, tables)


def unregister() -> None:
    bpy.app.translations.unregister(PACKAGE)

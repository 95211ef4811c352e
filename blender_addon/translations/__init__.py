"""The add-on's words and tooltips in other languages: tables for each, from the English ones. Where Blender has a word,
its own goes first, unless it has it in another sense; what a table lacks stays English."""

from collections.abc import Iterator

import bpy

from ..manual import groups, operators, shown
from ..preferences import PACKAGE
from ..settings.declared import OWN_SENSE
from . import de_DE, tips_de_DE, tips_zh_HANS, zh_HANS

# By the names that Blender has for languages.
TABLES = {"de_DE": de_DE.TABLE, "zh_HANS": zh_HANS.TABLE}
TIPS = {"de_DE": tips_de_DE.TIPS, "zh_HANS": tips_zh_HANS.TIPS}

# Blender looks for the names of operators in a context of their own.
_CONTEXTS = ("*", "Operator", OWN_SENSE)


def tooltips() -> Iterator[str]:
    """Every tooltip as Blender has it."""
    yield from (rna.description for _, rna in operators())
    for _, rna in (*operators(), *groups()):
        for one in shown(rna):
            yield one.description
            if one.type == "ENUM":
                yield from (item.description for item in one.enum_items)


def in_table(tooltip: str) -> str:
    """A tooltip as it stands in a table: how a docstring is broken and indented depends on the Python."""
    return " ".join(tooltip.split())


def register() -> None:
    tips = {tip: in_table(tip) for tip in tooltips()}
    words = {
        language: {
            **{("*", tip): TIPS[language][key] for tip, key in tips.items() if key in TIPS[language]},
            **{(context, english): word for english, word in table.items() for context in _CONTEXTS},
        }
        for language, table in TABLES.items()
    }
    bpy.app.translations.register(PACKAGE, words)


def unregister() -> None:
    bpy.app.translations.unregister(PACKAGE)

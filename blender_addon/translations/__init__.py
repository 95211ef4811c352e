"""The add-on's words in other languages: a table for each, from the English words. Where Blender has a word, its own
goes first; what a table lacks stays English."""

import bpy

from ..preferences import PACKAGE
from . import de_DE, zh_HANS

# By the names that Blender has for languages.
TABLES = {"de_DE": de_DE.TABLE, "zh_HANS": zh_HANS.TABLE}

# Blender looks for the names of operators in a context of their own.
_CONTEXTS = ("*", "Operator")


def register() -> None:
    words = {
        language: {(context, english): word for english, word in table.items() for context in _CONTEXTS}
        for language, table in TABLES.items()
    }
    bpy.app.translations.register(PACKAGE, words)


def unregister() -> None:
    bpy.app.translations.unregister(PACKAGE)

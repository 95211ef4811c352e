"""The examples in docstrings do what they say, and every field has a docstring."""

import ast
import doctest
import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import mpsnet_core
from mpsnet_core.errors import SettingsError

MODULES = [found.name for found in pkgutil.walk_packages(mpsnet_core.__path__, "mpsnet_core.", lambda _: None)]
PACKAGE = Path(mpsnet_core.__file__).parent
FILES = [*PACKAGE.rglob("*.py")]


def test_examples_are_true():
    tried = 0
    for name in MODULES:
        if name.endswith("__main__"):
            continue
        try:
            module = importlib.import_module(name)
        except (ImportError, SettingsError):  # for want of an extra
            continue
        found = doctest.testmod(module)
        assert found.failed == 0, name
        tried += found.attempted
    assert tried > 50


@pytest.mark.parametrize("name", sorted(mpsnet_core.__all__))
def test_what_the_package_offers_has_a_docstring(name: str):
    offered = getattr(mpsnet_core, name)
    assert not callable(offered) or (offered.__doc__ or "").strip()


def fields(record: ast.ClassDef) -> Iterator[tuple[ast.AnnAssign, ast.stmt | None]]:
    """The public fields of a class, each with the statement that follows it."""
    for field, following in zip(record.body, [*record.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and not ast.unparse(field).startswith("_") and not is_of_class(field):
            yield field, following


def is_of_class(field: ast.AnnAssign) -> bool:
    return ast.unparse(field.annotation).startswith("ClassVar")


def is_record(found: ast.AST) -> bool:
    """Whether it is a dataclass or a named tuple."""
    return isinstance(found, ast.ClassDef) and any(
        re.match(r"dataclass\b|NamedTuple$", ast.unparse(one)) for one in (*found.decorator_list, *found.bases)
    )


def options(tree: ast.Module) -> set[str]:
    """The functions by which a module makes options: those of every module, and its own that return one."""
    own = [found for found in tree.body if isinstance(found, ast.FunctionDef)]
    made = {"option", "optional", "output_option", "convention_option"}
    return {*made, *(found.name for found in own if ast.unparse(found.body[-1]).startswith("return option("))}


def is_described(field: ast.AnnAssign, following: ast.stmt | None, makers: set[str]) -> bool:
    """Whether a docstring follows the field, or it is an option, which has its help."""
    is_option = isinstance(field.value, ast.Call) and ast.unparse(field.value.func) in makers
    return is_option or (
        isinstance(following, ast.Expr)
        and isinstance(following.value, ast.Constant)
        and isinstance(following.value.value, str)
    )


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_every_field_has_a_docstring_below_it(file: Path):
    tree = ast.parse(file.read_text(encoding="utf-8"))
    makers = options(tree)
    for record in filter(is_record, ast.walk(tree)):
        bare = [ast.unparse(one.target) for one, after in fields(record) if not is_described(one, after, makers)]
        assert not bare, record.name

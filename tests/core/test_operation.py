"""Operations: what their description alone holds them to, in Python and on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from mpsnet_core import Bake, FileError, InputError
from mpsnet_core.cli.arguments import Parser, add_operation
from mpsnet_core.cli.command import OPERATIONS
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.io.provenance import operation_facts
from mpsnet_core.operation import Operation, Result, option, settings
from mpsnet_core.progress import Progress, silent


@dataclass(frozen=True)
class Answer(Result):
    given: dict[str, Any]
    missing: str | None = None


@dataclass(frozen=True)
class UsesMill(Operation):
    """What grinds."""

    heading: ClassVar[str] = "the mill"

    stones: tuple[str, ...] = option(default=(), help="a millstone", provenance="content")
    gap: int = option(default=0, help="between the stones")


@dataclass(frozen=True)
class Grind(UsesMill):
    """Grind beans to powder."""

    command: ClassVar[str] = "grind"

    beans: tuple[str, ...] = option(positional=True, help="bags of beans", provenance="none")
    roast: Literal["light", "dark"] = option(
        default="light", choices={"light": "", "dark": "bitter"}, help="how they were roasted"
    )
    size: float = option(default=0.5, low=0.1, high=2, metavar="MM", help="of the grains")
    turns: int | None = option(default=None, help="how many times the handle goes round", unset="until it is empty")
    water: tuple[str, ...] = option(default=(), help="a spring", provenance="none")
    slow: bool = option(default=False, help="take your time", provenance="none")
    recipe: str | None = option(default=None, help="file of a recipe", provenance="content")
    sieves: tuple[int, ...] = option(default=(3, 5), help="in a row")
    crank: str | None = option(default=None, help="", provenance="none")
    tilt: str | None = option(default=None, metavar="level|X,Y", help="of the mill", numbers=True)
    legs: tuple[str, ...] = option(default=(), metavar="X,Y", help="where a leg stands", numbers=True)
    output: str = option(help="bag for the powder", provenance="none")

    def run(self, progress: Progress = silent) -> Answer:
        progress(1.0, "done")
        return Answer({setting.name: getattr(self, setting.name) for setting in settings(type(self))}, text="ground")


def on_the_command_line(*arguments: str) -> dict[str, Any]:
    parser = Parser()
    add_operation(parser.add_subparsers(), Parser(add_help=False), Grind)
    options = parser.parse_args(["grind", *arguments])
    return options.verb(options, Reporter("none"))


def test_the_command_line_gives_what_python_gives() -> None:
    given = on_the_command_line(
        "a", "b", "--roast", "dark", "--size", "1", "--water", "x", "--water", "y", "--slow", "-o", "bag"
    )
    same = Grind(beans=("a", "b"), roast="dark", size=1.0, water=("x", "y"), slow=True, output="bag").run()
    assert given == same.facts() == {"text": "ground", "given": same.given}
    assert same.given["turns"] is None and given["given"]["recipe"] is None


def test_what_is_not_given_on_the_command_line_is_the_operation_s_own_default() -> None:
    assert on_the_command_line("a", "-o", "bag") == Grind(beans=("a",), output="bag").run().facts()


@pytest.mark.parametrize("kind", OPERATIONS, ids=lambda kind: kind.command)
def test_choices_are_those_of_the_type(kind: type[Operation]) -> None:
    hints = get_type_hints(kind)
    for setting in settings(kind):
        hint = next((one for one in get_args(hints[setting.name]) if get_origin(one) is Literal), hints[setting.name])
        if get_origin(hint) is Literal:
            assert tuple(setting.option.choices) == get_args(hint), setting.name


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (0.05, "0.05"),
        (2, "2"),
        (np.float64(0.1), "0.1"),
        ((45, 90.5), "45,90.5"),
        (np.array([0.25, -1]), "0.25,-1.0"),
        ("level", "level"),
        (None, None),
    ],
)
def test_text_of_numbers_may_be_given_as_numbers(given: Any, text: str | None) -> None:
    grind = Grind(beans="a", output="bag", tilt=given, legs=() if given is None else given)
    assert (grind.tilt, grind.legs) == (text, () if text is None else (text,))
    if text is not None:
        assert on_the_command_line("a", "-o", "bag", "--tilt", text, "--legs", text)["given"] == grind.run().given


def test_each_of_several_may_be_numbers() -> None:
    for legs in ([(1, 2), "3,4"], np.array([[1, 2], [3, 4]]), iter([(1, 2), [3, 4]])):
        assert Grind(beans="a", output="bag", legs=legs).legs == ("1,2", "3,4")  # type: ignore[arg-type]


def test_a_levels_scale_may_be_a_number() -> None:
    scales = [Bake(mesh="a.obj", view="c=n", output="t.png", level=level).level_scale() for level in (0.05, "0.05")]  # type: ignore[arg-type]
    assert scales == [0.05, 0.05]


def test_paths_are_taken_as_they_come() -> None:
    grind = Grind(beans=[Path("a")], output=Path("bag"))  # type: ignore[arg-type]
    assert grind.beans == ("a",) and grind.output == "bag"


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"roast": "burnt"}, "roast 'burnt' is not known; choose light or dark"),
        ({"size": 3.0}, "size 3 is out of range; choose 0.1 to 2"),
        ({"size": float("nan")}, "size nan is out of range; choose 0.1 to 2"),
    ],
)
def test_choices_and_bounds_hold(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Grind(beans=("a",), output="bag", **options)
    arguments = [part for name, value in options.items() for part in (f"--{name}", str(value))]
    with pytest.raises(InputError, match=sentence):
        on_the_command_line("a", *arguments, "-o", "bag")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"size": "1"}, "size '1' is not a number"),
        ({"turns": 1.5}, "turns 1.5 is not a whole number"),
        ({"sieves": [3, 5.5]}, "sieves 5.5 is not a whole number"),
        ({"slow": "false"}, "slow 'false' is neither true nor false"),
        ({"tilt": True}, "tilt True is not text"),
        ({"tilt": np.array(2)}, r"tilt array\(2\) is not text"),
        ({"tilt": (1, True)}, r"tilt \(1, True\) is not text"),
        ({"beans": []}, "grind lacks its option beans; give it"),
        ({"output": None}, "grind lacks its option output; give it"),
    ],
)
def test_what_no_option_can_be_is_refused(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Grind(**{"beans": ("a",), "output": "bag", **options})


def test_an_option_that_has_to_be_given_is_missed() -> None:
    with pytest.raises(InputError, match="required: -o/--output"):
        on_the_command_line("a")


def test_provenance_changes_with_what_makes_another_result_alone(tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.txt"
    recipe.write_text("fine")

    def facts(**options: Any) -> str:
        return operation_facts(Grind(**{"beans": ("a",), "output": "bag", "recipe": recipe, **options}))

    first = facts()
    assert facts(output="sack") == facts(beans=("b",)) == facts(slow=True) == first
    assert facts(size=1.0) != first
    recipe.write_text("coarse")
    assert facts() != first


def test_provenance_takes_each_of_several_files_by_its_content(tmp_path: Path) -> None:
    stones = [tmp_path / "upper", tmp_path / "lower"]
    for stone in stones:
        stone.write_text("granite")

    def facts() -> str:
        return operation_facts(Grind(beans=("a",), output="bag", stones=tuple(map(str, stones))))

    first = facts()
    stones[1].write_text("basalt")
    assert facts() != first
    stones[1].write_text("granite")
    assert facts() == first
    stones[1].unlink()
    with pytest.raises(FileError, match="lower"):
        facts()


def test_provenance_may_be_of_a_part_of_the_options() -> None:
    coarse, fine = (Grind(beans=("a",), output="bag", size=size) for size in (1.0, 0.5))
    wide = Grind(beans=("a",), output="bag", gap=3)
    assert operation_facts(coarse, UsesMill) == operation_facts(fine, UsesMill) != operation_facts(wide, UsesMill)
    assert operation_facts(fine, UsesMill) != operation_facts(fine, UsesMill, motor="steam")

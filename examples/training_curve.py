"""Draw how a training went: the error of its own photographs step by step, and that of models exported on the way.

    python examples/training_curve.py logs --model early.onnx --model later.onnx -o curve.svg

`logs` are folders that `mpsnet train --logs` wrote, the legs of one training in any order. A model gives one point: its
steps and its error on held-out samples, both from its record. Needs the extra `train`.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from mpsnet_core.estimate.onnx_model import OnnxModel

WIDTH, HEIGHT, MARGIN = 720, 360, 48
INK, TRAINED, HELD_OUT = "#666", "#4477aa", "#cc4433"
BINS = 3  # means for each doubling of the steps
FIRST = 500  # steps; before it the answers are of another size


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--model", action="append", default=[], type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    given.output.write_text(svg(angles(given.logs), [point(path) for path in given.model]), encoding="utf-8")
    print(f"wrote {given.output}")


def angles(folders: list[Path]) -> NDArray[np.float64]:
    """(N, 2) steps and degrees, means over ever more steps: those of one step leap about."""
    found: dict[int, float] = {}
    for folder in folders:
        events = EventAccumulator(str(folder), {"scalars": 0}).Reload().Scalars("training/angle_deg")
        found |= {event.step: event.value for event in events}
    steps = np.array([step for step in sorted(found) if step >= FIRST])
    values, groups = np.array([found[step] for step in steps.tolist()]), np.floor(np.log2(steps) * BINS)
    return np.array([(steps[groups == one].mean(), values[groups == one].mean()) for one in np.unique(groups)])


def point(model: Path) -> tuple[int, float]:
    record = OnnxModel(model).record
    if record is None:
        raise SystemExit(f"{model} has no record of its training; name a model that mpsnet train wrote")
    return record["steps"], record["validation_mae_deg"]


def svg(trained: NDArray[np.float64], held_out: list[tuple[int, float]]) -> str:
    """Steps along a logarithmic axis, as each doubling gains about the same; degrees upwards."""
    everything = np.vstack([trained, np.array(held_out).reshape(-1, 2)])
    first, last = np.log2(everything[:, 0].min()), np.log2(everything[:, 0].max())
    low, high = np.floor(everything[:, 1].min()) - 2, np.ceil(everything[:, 1].max())

    def x(step: float) -> float:
        return float(MARGIN + (np.log2(step) - first) / (last - first) * (WIDTH - 2 * MARGIN))

    def y(degrees: float) -> float:
        return float(HEIGHT - MARGIN - (degrees - low) / (high - low) * (HEIGHT - 2 * MARGIN))

    def text(at: tuple[float, float], words: str, colour: str = INK, anchor: str = "middle") -> str:
        return f'<text x="{at[0]:.0f}" y="{at[1]:.0f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'

    marks = [1000 * 2**power for power in range(20) if first <= np.log2(1000 * 2**power) <= last]
    line = " ".join(f"{x(step):.1f},{y(degrees):.1f}" for step, degrees in trained)
    degrees = range(int(low), int(high) + 1, max(1, int(high - low) // 8))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" '
            'font-size="13">',
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
            *(f'<path d="M{MARGIN} {y(one):.1f}H{WIDTH - MARGIN}" stroke="#ddd"/>' for one in degrees),
            *(text((MARGIN - 8, y(one) + 4), f"{one}°", anchor="end") for one in degrees),
            *(text((x(step), HEIGHT - MARGIN + 20), f"{step:,}") for step in marks),
            text((WIDTH / 2, HEIGHT - 8), "steps"),
            f'<polyline points="{line}" fill="none" stroke="{TRAINED}" stroke-width="2"/>',
            text((WIDTH - MARGIN, MARGIN - 20), "training photographs", TRAINED, "end"),
            text((WIDTH - MARGIN, MARGIN - 4), "held-out samples, once annealed", HELD_OUT, "end"),
            *(f'<circle cx="{x(step):.1f}" cy="{y(one):.1f}" r="4" fill="{HELD_OUT}"/>' for step, one in held_out),
            *(
                text((x(step), y(one) + 20 + 14 * (number % 2)), f"{one:.1f}°", HELD_OUT)
                for number, (step, one) in enumerate(held_out)
            ),
            "</svg>\n",
        ]
    )


if __name__ == "__main__":
    main()

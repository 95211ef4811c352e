"""Training data of both kinds: a few samples rendered by Blender's Cycles, and the same ones synthesised without it.

    python examples/training_data.py  (with `pip install -e '.[blender]'` in a copy of the repository)
    blender -b --python examples/training_data.py      (with the extension installed)

Leaves the samples in output/rendered and output/synthesised, and output/training_data.png: in each pair of rows the
rendered sample is above the synthesised one. Shapes, lights and materials agree; where noise spreads the materials,
each renderer has its own. What is there already is not made again: run it twice, or with a larger COUNT.
"""

import runpy
import time
from pathlib import Path

import bpy

from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.synthesis.contact_sheet import sheet_of_samples
from mpsnet_core.synthesis.farm.run import make_samples
from mpsnet_core.synthesis.job import SampleJob, read_job, sample_path

OUTPUT = Path(__file__).resolve().parent / "output"
COUNT, PIXELS, SEED = 4, 160, 1

runpy.run_path(str(Path(__file__).with_name("extension.py")))

OUTPUT.mkdir(exist_ok=True)
rendered, synthesised = OUTPUT / "rendered", OUTPUT / "synthesised"

started = time.monotonic()
bpy.ops.mps.render_samples(count=COUNT, size=PIXELS, seed=SEED, samples=32, output=str(rendered))
print(f"rendered: {rendered} ({time.monotonic() - started:.0f} s)")

# The same recipes, but for one bounce of light where Cycles has three.
started = time.monotonic()
outcome = make_samples(synthesised, SampleJob("synthesis", COUNT, SEED, PIXELS, shapes=read_job(rendered).shapes))
if outcome.failed:
    raise SystemExit(f"{len(outcome.failed)} samples failed: {next(iter(outcome.failed.values()))}")
print(f"synthesised: {synthesised} ({time.monotonic() - started:.0f} s)")

pairs = [sample_path(folder, number) for number in range(COUNT) for folder in (rendered, synthesised)]
write_picture(OUTPUT / "training_data.png", sheet_of_samples(pairs, len(pairs)))
print(f"the contact sheet is {OUTPUT / 'training_data.png'}")

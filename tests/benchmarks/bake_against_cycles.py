"""How long a bake from one view or several takes, as a share of Cycles' selected-to-active bake of the same mesh and
size.

    PYTHONPATH=.:tests/core/made python tests/benchmarks/bake_against_cycles.py [--size 2048] [--views 1] [--rounds 5]

Needs pip's bpy. The mesh is MPSNET_TEST_DATA/meshes/test/bunny.obj, or a bumpy sphere where there is none; its copy
has a tenth of its faces. Both bake with the same number of threads, in turn, each round anew: Cycles from its scene,
the core from its arrays; neither touches a file, and no process is started. By the clock, and by processor time, which
what else the machine does changes less. Ends with 1 where the median of the rounds' ratios by the clock is above 1.
"""

import argparse
import os
import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line sets it, and so Blender's child process

import bpy
import numpy as np
from quiet import quiet
from surface_shapes import camera_looking, sphere_view

from mpsnet_core.bake.bake import View, bake_normals
from tests.addon.rendering import activate, detailed_object, simplified
from tests.addon.test_bake_against_blender import mesh_of

MARGIN = 16


def prepare_cycles(simple: bpy.types.Object, size: int, threads: int) -> None:
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    material = bpy.data.materials.new("Material")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("Bake", size, size, float_buffer=True, is_data=True)
    material.node_tree.nodes.active = node
    simple.data.materials.clear()
    simple.data.materials.append(material)


def view_from(azimuth: float) -> View:
    """Seen from the front, or from an azimuth in radians; what the normals say does not matter for the time."""
    return sphere_view(camera_looking((np.sin(azimuth), -np.cos(azimuth), 0), size=1024, distance=5, reach=1.05))


def main() -> int:
    parser = argparse.ArgumentParser(description="Time the bake against Cycles' own.")
    parser.add_argument("--size", type=int, default=2048)
    parser.add_argument("--views", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    bunny = Path(os.environ.get("MPSNET_TEST_DATA", "")) / "meshes" / "test" / "bunny.obj"
    mesh_file = bunny if bunny.is_file() else None
    threads = os.cpu_count() or 1  # what the core uses

    with quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        detailed = detailed_object(mesh_file, subdivisions=7)
        simple = simplified(detailed, len(detailed.data.polygons) // 10)
        activate(simple, detailed)
        prepare_cycles(simple, arguments.size, threads)
    mesh = mesh_of(simple)
    views = [view_from(azimuth) for azimuth in np.arange(arguments.views) * 2 * np.pi / arguments.views]
    print(f"{mesh_file or 'a bumpy sphere'}: {len(detailed.data.polygons)} faces onto {len(simple.data.polygons)},")
    size = arguments.size
    print(f"{size} x {size} texels, margin {MARGIN}, {len(views)} view(s), {threads} threads")

    def cycles() -> None:
        with quiet():
            bpy.ops.object.bake(type="NORMAL", use_selected_to_active=True, cage_extrusion=0.03, margin=MARGIN)

    def core() -> None:
        bake_normals(replace(mesh), views, size=size, margin=MARGIN)

    # By the clock, and of processor time.
    spent: dict[str, list[tuple[float, float]]] = {"cycles": [], "core": []}
    for number in range(arguments.rounds + 1):
        for name, bake in (("cycles", cycles), ("core", core)) if number % 2 else (("core", core), ("cycles", cycles)):
            start = time.perf_counter(), time.process_time()
            bake()
            if number:  # the first round warms up
                spent[name].append((time.perf_counter() - start[0], time.process_time() - start[1]))
    medians = []
    for words, place in (("by the clock", 0), ("of processor time", 1)):
        core_seconds, cycles_seconds = ([one[place] for one in spent[name]] for name in ("core", "cycles"))
        ratios = [a / b for a, b in zip(core_seconds, cycles_seconds, strict=True)]
        medians.append(statistics.median(ratios))
        print(
            f"{words}: core least {min(core_seconds):.2f} s, median {statistics.median(core_seconds):.2f} s; cycles "
            f"least {min(cycles_seconds):.2f} s, median {statistics.median(cycles_seconds):.2f} s; core / cycles least "
            f"by least {min(core_seconds) / min(cycles_seconds):.2f}, median {medians[-1]:.2f}"
        )
    return int(medians[0] > 1)


if __name__ == "__main__":
    sys.exit(main())

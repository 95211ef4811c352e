"""How good a texture becomes of eight noisy views with slightly wrong cameras, without and with levelling.

PYTHONPATH=tests/core python tests/benchmarks/many_views.py [--size 2048] [--pixels 900] [--reach 1.1] [--feather 0.03]
"""

import argparse

from eight_views import eight_views_baked

from mpsnet_core.surface.feather import FEATHER


def main() -> None:
    parser = argparse.ArgumentParser(description="Bake eight views of a bumpy sphere whose normals are known.")
    parser.add_argument("--size", type=int, default=2048, help="of the texture")
    parser.add_argument("--pixels", type=int, default=900, help="of each photo's side")
    parser.add_argument("--reach", type=float, default=1.1, help="half of every second picture's width, in radii")
    parser.add_argument("--feather", type=float, default=FEATHER, help="share of the mesh's size; 0 for none")
    options = parser.parse_args()
    for how, outcome in eight_views_baked(
        options.size, options.pixels, reach=options.reach, feather=options.feather
    ).items():
        print(f"{how}: {outcome}")


if __name__ == "__main__":
    main()

"""How good a texture becomes of eight noisy views with slightly wrong cameras, without and with levelling and feather.

PYTHONPATH=tests/core/made python tests/benchmarks/many_views.py [--size 2048] [--pixels 900] [--reach 0.7] [--shadows]
"""

import argparse

from eight_views import all_levelled, outcome, sphere_texels, wrong_views

from mpsnet_core.bake.feather import FEATHER


def main() -> None:
    parser = argparse.ArgumentParser(description="Bake eight views of a bumpy sphere whose normals are known.")
    parser.add_argument("--size", type=int, default=2048, help="of the texture")
    parser.add_argument("--pixels", type=int, default=900, help="of each photo's side")
    parser.add_argument("--reach", type=float, default=0.7, help="half the width of four of the pictures, in radii")
    parser.add_argument("--feather", type=float, default=FEATHER, help="share of the mesh's size")
    parser.add_argument(
        "--shadows", action="store_true", help="photos with attached shadows, as Lambert's estimate errs"
    )
    options = parser.parse_args()
    views, texels = (
        wrong_views(options.pixels, reach=options.reach, shadows=options.shadows),
        sphere_texels(options.size),
    )
    level = all_levelled(views)
    for words, chosen in (("as they are", views), ("levelled", level), ("levelled, the last four alone", level[4:])):
        for feather in (0.0, options.feather):
            print(f"{words}, feather {feather:g}: {outcome(chosen, texels, feather)}", flush=True)


if __name__ == "__main__":
    main()

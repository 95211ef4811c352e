"""Average the weights of networks that were fine-tuned from one, as the shipped default was made.

    python examples/average_networks.py first.onnx=0.3 second.onnx=0.3 start.onnx=0.4 -o mean.onnx

Each leg of fine-tuning errs in a way of its own, and the mean of their weights errs less than any of them (Wortsman et
al. 2022, "Model soups"). That holds only for legs that began at the same weights, or at each other's. The record of the
training is the first one's, with the shares beside it, and without its errors on held-out samples, which are not the
mean's. Needs the extra `train`.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from mpsnet_core.estimate.card import CARD_KEY, TRAINING_KEY, card_from_metadata


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("networks", nargs="+", metavar="FILE=SHARE")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    files, shares = zip(*(one.rsplit("=", 1) for one in given.networks), strict=True)
    mean = average([onnx.load(file) for file in files], [float(share) for share in shares])
    onnx.save(mean, str(given.output))
    print(f"wrote {given.output}")


def average(models: list[onnx.ModelProto], shares: list[float]) -> onnx.ModelProto:
    """The first model with the mean of all weights. shares: of each model, 1 in sum."""
    if not np.isclose(sum(shares), 1):
        raise SystemExit(f"the shares have a sum of {sum(shares):g}; make it 1")
    # By their order: the exporter numbers the names anew where the code has changed since.
    weights = [[numpy_helper.to_array(one) for one in model.graph.initializer] for model in models]
    records = [{entry.key: entry.value for entry in model.metadata_props} for model in models]
    for other, record in zip(weights[1:], records[1:], strict=True):
        # As cards, not as text: an older file's may lack what has a default.
        same = card_from_metadata(record) == card_from_metadata(records[0])
        if not same or [one.shape for one in other] != [one.shape for one in weights[0]]:
            raise SystemExit("these are different networks; only legs of one training have a mean")
    for one, *values in zip(models[0].graph.initializer, *weights, strict=True):
        if values[0].dtype.kind == "f":
            parts = [share * each.astype(np.float64) for share, each in zip(shares, values, strict=True)]
            one.CopyFrom(numpy_helper.from_array(np.sum(parts, axis=0).astype(values[0].dtype), one.name))
    own = [json.loads(record[TRAINING_KEY]) for record in records]
    legs = [
        {"share": share, "steps": leg["steps"], "seed": leg["recipe"]["seed"], "samples": leg["samples_fingerprint"]}
        for share, leg in zip(shares, own, strict=True)
    ]
    record = {**own[0], "validation_mae_deg": None, "validation_rank_correlation": None, "mean_of": legs}
    onnx.helper.set_model_props(models[0], {CARD_KEY: records[0][CARD_KEY], TRAINING_KEY: json.dumps(record)})
    return models[0]


if __name__ == "__main__":
    main()

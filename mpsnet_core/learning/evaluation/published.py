"""The paper's results, to compare with ours.

Ju et al., "MPS-Net: Learning to Recover Surface Normal for Multispectral Photometric Stereo", Neurocomputing 2019. Mean
angular errors in degrees.
"""

from typing import Any

Lights = tuple[int, int, int]

# DiLiGenT's objects, in the paper's order and sorted.
_OBJECTS = ("ball", "bear", "pot1", "pot2", "goblet", "reading", "cow", "harvest", "cat", "buddha")
OBJECTS = tuple(sorted(_OBJECTS))


def _by_object(*errors: float) -> dict[str, float]:
    return dict(zip(_OBJECTS, errors, strict=True))


# Table 1: MPS-Net by patch side, on rendered patches, without and with initial normals as an input.
TABLE_1: dict[str, dict[int, float]] = {
    "image": {1: 10.09, 3: 9.18, 5: 8.75, 7: 8.53, 9: 10.20},
    "image and initial normals": {1: 8.28, 3: 7.41, 5: 7.03, 7: 7.11, 9: 7.72},
}

# Table 2: MPS-Net on DiLiGenT, by the lights of the red, green and blue channel.
TABLE_2: dict[Lights, dict[str, float]] = {
    (48, 1, 96): _by_object(5.39, 9.74, 10.61, 10.69, 11.43, 17.10, 10.78, 16.02, 9.90, 11.54),
    (8, 41, 89): _by_object(5.35, 9.91, 10.50, 10.99, 12.07, 17.31, 10.29, 15.44, 9.31, 11.58),
    (73, 72, 27): _by_object(5.17, 9.44, 10.29, 10.93, 11.40, 17.85, 9.92, 15.81, 8.97, 10.73),
    (22, 50, 78): _by_object(5.52, 10.03, 10.51, 11.36, 12.25, 17.41, 10.13, 16.55, 9.46, 10.93),
}

# Figure 6: MPS-Net on rendered meshes with one and with several materials.
FIGURE_6 = (7.06, 5.38, 8.96, 9.12)

# Figure 8: the paper's comparison on DiLiGenT. Its values of MPS-Net for bear and buddha are in no row of table 2.
FIGURE_8: dict[str, dict[str, float]] = {
    "MPS-Net": {"goblet": 11.43, "reading": 17.10, "bear": 8.40, "buddha": 9.54},
    "PS-FCN": {"goblet": 13.92, "reading": 19.74, "bear": 12.29, "buddha": 12.69},
    "Demultiplexer": {"goblet": 12.46, "reading": 22.62, "bear": 18.77, "buddha": 14.10},
    "baseline": {"goblet": 15.80, "reading": 21.81, "bear": 18.87, "buddha": 16.31},
}

PUBLISHED_LIGHTS: tuple[Lights, ...] = tuple(TABLE_2)


def diligent_figures(objects: list[str], lights: list[Lights]) -> list[dict[str, Any]]:
    """Values of table 2 and figure 8 for these objects and lights, as ``--json`` writes them.

    Their "lights" are numbers of three lights, None for figure 8, which does not name them.
    """
    rows: list[tuple[Any, ...]]
    rows = [(triple, "MPS-Net", errors, "Table 2") for triple, errors in TABLE_2.items() if triple in lights]
    rows += [(None, model, errors, "Figure 8") for model, errors in FIGURE_8.items()]
    return [
        {
            "object": name,
            "lights": triple and list(triple),
            "model": model,
            "mae_deg": errors[name],
            "source": source,
            "protocol": "published",
        }
        for triple, model, errors, source in rows
        for name in objects
        if name in errors
    ]

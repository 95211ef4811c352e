"""Cameras as Metashape writes them."""

from pathlib import Path

import numpy as np
from photogrammetry_scene import TURN

CALIBRATION = {"f": 520.0, "cx": 4.5, "cy": -7.25, "b1": 3.5, "b2": -1.75}

POSITION = np.array([0.4, -0.3, -6.0])

SENSOR = """
    <sensors next_id="2">
      <sensor id="0" label="unknown" type="frame">
        <resolution width="640" height="480"/>
        <property name="layer_index" value="0"/>
        <bands><band label="Red"/></bands>
        <calibration type="frame" class="initial"><resolution width="640" height="480"/><f>9999</f></calibration>
        <calibration type="{kind}" class="adjusted">
          <resolution width="640" height="480"/>
          {calibration}
        </calibration>
        <covariance><params>f cx cy</params><coeffs>1 0 0 0 1 0 0 0 1</coeffs></covariance>
      </sensor>
    </sensors>"""

CAMERAS = """
    <cameras next_id="4" next_group_id="1">
      <camera id="0" sensor_id="0" {component} label="DSC_0002">
        <transform>{transform}</transform>
        <rotation_covariance>1 0 0 0 1 0 0 0 1</rotation_covariance>
        <orientation>1</orientation>
      </camera>
      <camera id="1" sensor_id="0" label="not aligned"><orientation>1</orientation></camera>
      <camera id="2" sensor_id="0" label="disabled" enabled="0"><transform>{transform}</transform></camera>
      <camera id="3" sensor_id="0" label="disabled too" enabled="false"><transform>{transform}</transform></camera>
      <group id="0" label="Group 1" type="folder">
        <camera id="4" sensor_id="0" {component} label="DSC_0001.JPG" enabled="true">
          <transform>{transform}</transform>
        </camera>
      </group>
    </cameras>"""

DOCUMENT = """<?xml version="1.0" encoding="UTF-8"?>
<document version="{version}">
  <chunk label="Chunk 1" enabled="true">{sensor}{cameras}{rest}
  </chunk>
</document>
"""

LOCAL = '<reference>LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]</reference>'


def cameras_file(
    folder: Path,
    *,
    calibration: dict[str, float | str] = CALIBRATION,
    kind: str = "frame",
    transform: str | None = None,
    component: str = "",
    sensor: str = SENSOR,
    cameras: str = CAMERAS,
    rest: str = LOCAL,
    version: str = "1.5.0",
) -> Path:
    given = "\n          ".join(f"<{name}>{value}</{name}>" for name, value in calibration.items())
    if transform is None:
        transform = " ".join(map(repr, np.vstack([np.c_[TURN, POSITION], [0, 0, 0, 1]]).ravel().tolist()))
    text = DOCUMENT.format(
        version=version,
        sensor=sensor.format(kind=kind, calibration=given),
        cameras=cameras.format(transform=transform, component=component),
        rest=rest,
    )
    (folder / "cameras.xml").write_text(text, encoding="utf-8")
    return folder / "cameras.xml"

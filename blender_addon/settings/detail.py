"""Detail only: settings shared by the bakes of one photo and of many views."""

from typing import Any

from mpsnet_core.defaults import LEVEL_SCALE, MAX_LEVEL_SCALE, MIN_LEVEL_SCALE

from .declared import BoolSetting, FloatSetting


def detail_only(*, default: bool) -> Any:
    return BoolSetting(
        name="Detail Only",
        description="Take large shapes from the object and only detail from the photos, whatever else the estimates "
        "say: seams between views vanish",
        default=default,
    )


def cut_off() -> Any:
    return FloatSetting(
        name="Cut-Off",
        description="What is smaller than about twice this fraction of the object's size is detail, and taken from the "
        "photos",
        default=LEVEL_SCALE,
        min=MIN_LEVEL_SCALE,
        max=MAX_LEVEL_SCALE,
        precision=3,
    )

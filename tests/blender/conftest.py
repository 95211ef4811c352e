"""Makes the fixtures of a real Blender known to every test here."""

from blender_fixtures import album, blender, extension_zip, unfolded, window  # noqa: F401

"""Training: networks, recipes, the training loop, export to ONNX. Needs PyTorch (extra ``train``)."""

from importlib.util import find_spec

from mpsnet_core.errors import SettingsError

for _name, _library in (("torch", "PyTorch"), ("onnx", "ONNX"), ("tensorboard", "TensorBoard")):
    if find_spec(_name) is None:
        raise SettingsError(f"training needs {_library}: pip install '.[train]' in a copy of the repository")

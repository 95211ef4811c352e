"""Training of the networks, and evaluation of all models."""

import os
import tempfile

# Importing parts of PyTorch creates this folder, for compiled code that we do not need. One that exists is not created.
os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", tempfile.gettempdir())

"""A pytest plugin that runs one case of each test: `python -m pytest -p tests.core.one_of_each`.

For another version of Python or Blender, where the same lines have to run, and the values have been tested. Tests of
messages keep all their cases: each is of other lines, and words may come from Python.
"""

import pytest


@pytest.hookimpl(trylast=True)  # of those that marks leave
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    kept, others, seen = [], [], set()
    for item in items:
        test = item.nodeid.partition("[")[0]
        (others if test in seen and "sentence" not in test else kept).append(item)
        seen.add(test)
    config.hook.pytest_deselected(items=others)
    items[:] = kept

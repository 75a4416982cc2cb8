"""A model file that is edited while a program runs keeps the equations that it was loaded with."""

from __future__ import annotations

import importlib.util
import sys

from multibody import Model

BEFORE = '''from multibody import Component, Parameter, Translation


class Push(Component):
    """A constant force."""

    size = Parameter(3.0, "N", "force")
    flange = Translation("where it acts")

    def equations(self):
        self.flange.force = self.size
'''


def test_an_edit_during_the_run_changes_nothing(tmp_path):
    file = tmp_path / "pushing.py"
    file.write_text(BEFORE)
    spec = importlib.util.spec_from_file_location("pushing", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["pushing"] = module
    spec.loader.exec_module(module)
    file.write_text("# a line more\n" + BEFORE.replace("self.size", "2.0 * self.size"))
    from multibody.library import Mass

    model = Model("pushed")
    body = model.add("body", Mass(m=1.0))
    model.connect(model.add("push", module.Push()).flange, body.flange)
    system = model.build()
    del sys.modules["pushing"]
    assert system.rhs(0.0, system.start)[system.index("state", "body.velocity")] == 3.0

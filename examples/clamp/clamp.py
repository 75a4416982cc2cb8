"""A hydraulic clamp: a pump moves a piston against a spring.  As its designer would model it, every seal is tight."""

from multibody import Model
from multibody.library import Cylinder, FlowSource, Mass, Spring, ViscousFriction, Volume


def build() -> Model:
    model = Model("clamp")
    pump = model.add("pump", FlowSource())
    oil = model.add("oil", Volume(capacity=4e-13))  # 0.4 l of oil and a hose
    cylinder = model.add("cylinder", Cylinder(area_a=5e-4, area_b=5e-4))
    jaw = model.add("jaw", Mass(m=8.0))
    guide = model.add("guide", ViscousFriction(viscous=1500.0))
    spring = model.add("spring", Spring(stiffness=2e5))
    model.connect(pump.a, model.ground)
    model.connect(pump.b, oil.port, cylinder.a)
    model.connect(cylinder.b, model.ground)  # the other chamber is open
    model.connect(cylinder.piston, jaw.flange, guide.b, spring.b)
    model.connect(guide.a, spring.a, model.ground)
    model.input("pump.flow", pump.flow)
    return model

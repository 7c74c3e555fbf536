"""Friction and restitution in exported files: measured values, bounds, and what MuJoCo makes of them."""

from __future__ import annotations

import math
from dataclasses import replace
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

from analyze.export.contact import (
    MjcfContact,
    contact_notes,
    damping_ratio,
    export_contact,
    restitution_of,
)
from analyze.export.formats import Format
from analyze.export.write import write_body
from schemas.contact_result import ContactPropertiesResult, FrictionResult, RestitutionResult
from schemas.quantity import Quantity
from tests.analyze.export.bodies import body_of

STEP = 2e-4


def friction(value: float | None, at_least: float) -> FrictionResult:
    known = value is not None
    quantity = Quantity(value=value, unit="1", sd=0.01 if known else None, observed=known)
    return FrictionResult(coefficient=quantity, at_least=at_least, scatter=None, strikes=[])


def restitution(value: float) -> RestitutionResult:
    mean = Quantity(value=value, unit="1", sd=0.01, interval95=[value - 0.02, value + 0.02])
    return RestitutionResult(mean=mean, scatter=0.04, speed_m_s=1.3, landings=[])


class WithContact:
    """Result with contact properties, which is all that these functions read."""

    def __init__(self, friction: FrictionResult | None, restitution: RestitutionResult | None = None) -> None:
        self.contact_properties = ContactPropertiesResult(
            object="tea box", table="oak", friction=friction, restitution=restitution, rolling_arm=None
        )


def dropped(restitution: float) -> float:
    """Restitution that a box dropped flat on a plane has in MuJoCo."""
    contact = " ".join(f'{k}="{v}"' for k, v in MjcfContact(0.4, restitution).attributes().items())
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}"/><worldbody><geom type="plane" size="1 1 0.1"/>'
        f'<body pos="0 0 0.1"><freejoint/><geom type="box" size="0.04 0.03 0.05" density="300" {contact}/>'
        "</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    speed = []
    for _ in range(round(0.25 / STEP)):
        mujoco.mj_step(model, data)
        speed.append(float(data.qvel[2]))
    return max(speed) / -min(speed)


@pytest.mark.parametrize("value", [0.05, 0.2, 0.5, 0.8])
def test_a_box_that_mujoco_drops_has_the_restitution(value):
    assert dropped(value) == pytest.approx(value, abs=0.02)


@pytest.mark.parametrize("damping", [0.05, 0.4, 0.999999, 1.0, 1.3, 4.0])
def test_the_damping_ratio_is_found_again(damping):
    assert damping_ratio(restitution_of(damping)) == pytest.approx(damping, rel=1e-3)


def test_a_critically_damped_contact_gives_back_a_seventh():
    assert restitution_of(1.0) == pytest.approx(math.exp(-2))


def test_a_measured_friction_replaces_the_stated_one():
    found = export_contact(WithContact(friction(0.42, 0.4)), 0.6)  # type: ignore[arg-type]
    assert (found.friction, found.measured) == (0.42, True)
    assert found.notes["friction"]["source"] == "measured: tea box on oak"


@pytest.mark.parametrize(
    ("stated", "bound", "written"),
    [(None, 0.28, None), (0.4, 0.28, 0.4), (0.2, 0.28, None), (None, 1.2, 1.2)],
)
def test_a_bound_is_never_written_as_a_value(stated, bound, written):
    """The simulator's default of 1 stays where it is not below the bound."""
    found = export_contact(WithContact(friction(None, bound)), stated)  # type: ignore[arg-type]
    assert (found.friction, found.measured) == (written, False)
    assert found.notes["friction_bound"]["at_least"] == bound


def test_without_contact_properties_the_stated_friction_is_written():
    class Nothing:
        contact_properties = None

    found = export_contact(Nothing(), 0.6)  # type: ignore[arg-type]
    assert (found.friction, found.restitution, found.measured) == (0.6, None, False)


def test_friction_and_restitution_reach_every_format(tmp_path):
    body = replace(body_of("box"), friction=0.42, restitution=0.35, friction_measured=True)
    write_body(body, Format.MJCF, tmp_path / "out.xml")
    geom = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml")).geom("thing_collision")
    assert geom.friction[0] == pytest.approx(0.42)
    assert int(geom.priority[0]) == 1
    assert restitution_of(float(geom.solref[1])) == pytest.approx(0.35)
    write_body(body, Format.SDF, tmp_path / "out.sdf")
    surface = ET.parse(tmp_path / "out.sdf").getroot().find("model/link/collision/surface")
    assert float(surface.findtext("friction/ode/mu")) == pytest.approx(0.42)
    assert float(surface.findtext("bounce/restitution_coefficient")) == pytest.approx(0.35)
    write_body(body, Format.URDF, tmp_path / "out.urdf")
    extension = ET.parse(tmp_path / "out.urdf").getroot().find("gazebo")
    assert float(extension.findtext("mu1")) == pytest.approx(0.42)
    assert float(extension.findtext("collision/surface/bounce/restitution_coefficient")) == 0.35


def test_an_unmeasured_contact_leaves_urdf_as_it_was(tmp_path):
    write_body(replace(body_of("box"), friction=0.6), Format.URDF, tmp_path / "out.urdf")
    assert ET.parse(tmp_path / "out.urdf").getroot().find("gazebo") is None


def test_notes_name_the_pair():
    result = WithContact(friction(0.42, 0.4), restitution(0.3))
    contact = export_contact(result, None)  # type: ignore[arg-type]
    body = replace(
        body_of("box"), friction=0.42, restitution=0.3, friction_measured=True, provenance=contact.notes
    )
    first, second = contact_notes(body, result)  # type: ignore[arg-type]
    assert first == "friction 0.42 is measured for tea box on oak only"
    assert second.startswith("restitution 0.3 is measured for tea box on oak only")
    assert np.isfinite(contact.restitution)

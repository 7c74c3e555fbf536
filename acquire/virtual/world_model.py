"""MuJoCo model of one object on the table and the striker's arm.

The object's mass properties are given explicitly. It touches the table with the spheres of `contact_shape`,
and the striker's tip with its own shape (a primitive, or convex parts loaded as meshes). What the model
leaves out: air, an elastic shell, a rough table, cards that stand off the surface, play and bending of the
arm.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.contact_shape import contact_centres
from acquire.virtual.moving_contents import contents_xml
from acquire.virtual.station import ARM_LENGTH_M, TIP_RADIUS_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject

TIMESTEP_S = 0.0002
"""time step of the integration [s]"""
ARM_MASS_KG = 0.05
"""mass of the arm [kg], at half its length"""
ARM_DAMPING = 0.0005
"""damping of the hinge [N m s/rad]; the gear's drag is part of the motor's torque"""
TABLE_CONTACT = 'solref="0.001 1" solimp="0.995 0.9995 0.0001"'
"""MuJoCo's parameters of the contact with the table: stiff, without restitution, 10 um deep at rest"""
BOUNCE_RATE = 2000.0
"""natural frequency of a contact with restitution [rad/s]: it lasts 1.6 ms"""
STRIKER_CONTACT = 'solref="0.0035 0.36" solimp="0.99 0.99 0.001"'
"""MuJoCo's parameters of the contact with the tip: 800 rad/s with a damping ratio of 0.36, so that it lasts
3 ms with a restitution of about 0.4"""
STRIKER_FRICTION = 0.1
"""coefficient of friction of the polished tip; at 0.3 a fifth of the impulse would be lost in friction
against the rising face"""


def table_contact(restitution: float) -> str:
    """MuJoCo's parameters of the contact with a table of a coefficient of restitution, as XML attributes.

    A contact is a damped oscillator: restitution exp(-pi z / sqrt(1 - z^2)) for a damping ratio z. What the
    body as a whole gives back differs, because several of its contacts share a landing.

    Args:
        restitution: coefficient of restitution of one contact, 0 to 0.9.
    """
    if restitution <= 0.0:
        return TABLE_CONTACT
    loss = -math.log(restitution) / math.pi
    damping = loss / math.sqrt(1.0 + loss * loss)
    return f'solref="{1.0 / (BOUNCE_RATE * damping):.9g} {damping:.9g}" solimp="0.995 0.9995 0.0001"'


def model_xml(
    virtual_object: VirtualObject, gravity_world: NDArray[np.float64], restitution: float = 0.0
) -> str:
    """MuJoCo model (MJCF XML text) of table, object and striker's arm.

    Args:
        virtual_object: the object: mass properties, contact spheres, shape and friction.
        gravity_world: (3,) gravity in W (world frame, z normal to the table) [m/s2]; not along -z if the
            table is tilted.
        restitution: coefficient of restitution of a contact with the table, 0 to 0.9.
    """
    body = virtual_object.rigid_body
    I = body.inertia_com  # noqa: E741 - the field's name
    inertia = _numbers([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
    friction = f'friction="{virtual_object.friction:.9g} 0.005 0.0001"'
    sphere = f'type="sphere" size="{virtual_object.edge_radius_m:.9g}" contype="0" conaffinity="1" {friction}'
    spheres = "\n".join(
        f'<geom {sphere} pos="{_numbers(centre)}"/>' for centre in contact_centres(virtual_object)
    )
    meshes, shapes = _striker_shapes(virtual_object)
    arm_armature = virtual_object.arm_inertia_kg_m2 - ARM_MASS_KG * (ARM_LENGTH_M / 2) ** 2
    return f"""<mujoco>
<option timestep="{TIMESTEP_S}" integrator="implicitfast" cone="elliptic" impratio="100"
        gravity="{_numbers(gravity_world)}" tolerance="1e-12" iterations="50"/>
<compiler balanceinertia="false"/>
<asset>{meshes}</asset>
<worldbody>
<geom name="table" type="plane" size="2 2 0.1" contype="1" conaffinity="0" priority="1"
      {friction} {table_contact(restitution)}/>
<body name="object" pos="0 0 0">
<freejoint name="object"/>
<inertial pos="{_numbers(body.com_object)}" mass="{body.mass_kg:.12g}" fullinertia="{inertia}"/>
{spheres}
{shapes}
{contents_xml(virtual_object.contents)}
</body>
<body name="arm" pos="0 0 1">
<joint name="arm" type="hinge" axis="0 -1 0" armature="{arm_armature:.9g}" damping="{ARM_DAMPING}"/>
<inertial pos="0 0 {-ARM_LENGTH_M / 2}" mass="{ARM_MASS_KG}" diaginertia="1e-7 1e-7 1e-7"/>
<geom name="tip" type="sphere" size="{TIP_RADIUS_M}" pos="0 0 {-ARM_LENGTH_M}"
      contype="2" conaffinity="0" priority="1" friction="{STRIKER_FRICTION} 0.005 0.0001" {STRIKER_CONTACT}/>
</body>
</worldbody>
</mujoco>"""


def _striker_shapes(virtual_object: VirtualObject) -> tuple[str, str]:
    """Object's shape for collisions with the striker's tip: texts of assets and of geoms in MJCF.

    MJCF is MuJoCo's XML. A box or cylinder needs no assets (empty text); other shapes give one mesh per
    convex part.
    """
    shape = virtual_object.spec.shape
    collide = 'contype="0" conaffinity="2"'
    if shape.box is not None:
        return "", f'<geom type="box" size="{_numbers(np.array(shape.box.size_m) / 2)}" {collide}/>'
    if shape.cylinder is not None:
        size = f"{shape.cylinder.radius_m} {shape.cylinder.height_m / 2}"
        return "", f'<geom type="cylinder" size="{size}" {collide}/>'
    parts = virtual_object.convex_parts
    assets = "".join(
        f'<mesh name="part{i}" vertex="{_numbers(part.ravel())}"/>' for i, part in enumerate(parts)
    )
    # MuJoCo moves a mesh into its own principal frame and corrects the geom's pose for that, so pos is that
    # of O.
    return assets, "".join(f'<geom type="mesh" mesh="part{i}" {collide}/>' for i in range(len(parts)))


def _numbers(values: NDArray[np.float64] | list[float]) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)

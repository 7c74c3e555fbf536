"""Entry of the Result document on the fixture that was struck with the object and subtracted."""

from __future__ import annotations

from pydantic import Field

from schemas.document import Document, Matrix3, Vector3
from schemas.quantity import Quantity


class FixturePart(Document):
    """One body of the fixture, as the object file states it."""

    name: str
    """name of the body in the object file"""
    mass: Quantity
    """mass of the body [kg]"""
    centre_of_mass_m: Vector3 = Field(description="its centre of mass, in O")


class ErrorByCause(Document):
    """Errors of the object alone from one cause: strikes, fixture, or the object's pose in the fixture."""

    cause: str
    """cause in words"""
    com_sd_m: Vector3 = Field(description="1 sigma of the centre of mass from it alone, along O's axes")
    inertia_sd_kg_m2: Matrix3 = Field(description="1 sigma of the tensor's entries from it alone")


class FixtureResult(Document):
    """Fixture of the object, the body that was struck, and the errors by cause after subtracting it.

    All other quantities of the result are those of the object alone, except those of single strikes.
    """

    parts: list[FixturePart]
    """bodies that were subtracted"""
    struck_mass: Quantity
    """mass of object and fixture together [kg]"""
    struck_centre_of_mass: Quantity
    """their centre of mass [m, in O]"""
    struck_inertia: Quantity
    """their inertia tensor about that centre [kg m^2]"""
    errors: list[ErrorByCause]
    """errors of the object alone by their cause; their squares add up for the centre of mass"""

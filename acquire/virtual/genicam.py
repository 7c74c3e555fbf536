"""Descriptions of cameras (GenICam XML), which name the registers of virtual cameras as makers do.

Source: GenICam Standard, GenApi schema 1.0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal
from xml.etree import ElementTree as ET

_NAMESPACE = "http://www.genicam.org/GenApi/Version_1_0"


class Description:
    """Description that is made feature by feature.

    Args:
        vendor: name of the maker.
        model: name of the model.
        transport: GEV (GigE Vision), whose registers have the most significant byte first, or U3V (USB3
            Vision), where it is last.
    """

    def __init__(self, vendor: str, model: str, transport: Literal["GEV", "U3V"] = "GEV") -> None:
        self._order = "BigEndian" if transport == "GEV" else "LittleEndian"
        versions = {f"Schema{part}Version": "1" for part in ("Major", "Minor", "SubMinor")}
        versions |= {f"{part}Version": "1" for part in ("Major", "Minor", "SubMinor")}
        names = {"ModelName": _word(model), "VendorName": _word(vendor), "StandardNameSpace": transport}
        self._root = ET.Element(
            "RegisterDescription",
            {**names, **versions, "ProductGuid": "0", "VersionGuid": "0", "xmlns": _NAMESPACE},
        )
        self._category = ET.SubElement(self._root, "Category", Name="Root")

    def text(self, name: str, address: int, length: int) -> None:
        """Add a text that can only be read, of `length` bytes at most."""
        node = self._feature("StringReg", name)
        _children(node, Address=hex(address), Length=length, AccessMode="RO", pPort="Device")

    def integer(self, name: str, address: int, low: int, high: int, step: int = 1, lock: str = "") -> None:
        """Add an integer from `low` to `high` in steps of `step`; `lock` as in `choice`."""
        node = self._feature("Integer", name)
        _lock(node, lock)
        _children(node, pValue=self._register(name, address), Min=low, Max=high, Inc=step)

    def counter(self, name: str, address: int) -> None:
        """Add an integer of 64 bits that can only be read."""
        node = self._feature("Integer", name)
        _children(node, pValue=self._register(name, address, length=8, access="RO"))

    def number(self, name: str, address: int, bounds: tuple[float, float | str], to: str, back: str) -> None:
        """Add a number that an integer register holds in other units.

        Args:
            name: name of the feature.
            address: its register, an integer.
            bounds: smallest and largest value; the largest may be the name of a formula.
            to: formula of the register's value, of FROM.
            back: formula of the number, of TO.
        """
        node = self._feature("Float", name)
        highest = {"pMax" if isinstance(bounds[1], str) else "Max": bounds[1]}
        _children(node, pValue=f"{name}Converter", Min=bounds[0], **highest)
        converter = ET.SubElement(self._root, "Converter", Name=f"{name}Converter")
        _children(converter, FormulaTo=to, FormulaFrom=back, pValue=f"{name}Integer")
        # With bounds, so that the formulas are not taken at 0.
        whole = ET.SubElement(self._root, "Integer", Name=f"{name}Integer")
        _children(whole, pValue=self._register(name, address), Min=1, Max=10**8)

    def bit_command(self, name: str, address: int, bit: int) -> None:
        """Add a command that sets one bit of a register, counted from the most significant."""
        node = self._feature("Command", name)
        register = ET.SubElement(self._root, "MaskedIntReg", Name=f"{name}Register")
        _children(register, Address=hex(address), Length=4, AccessMode="RW", pPort="Device", Bit=bit)
        _children(register, Sign="Unsigned", Endianess=self._order)
        _children(node, pValue=f"{name}Register", CommandValue=1)

    def formula(self, name: str, formula: str, variables: Mapping[str, str]) -> None:
        """Add a number for other features, of variables that stand for features or registers."""
        node = ET.SubElement(self._root, "SwissKnife", Name=name)
        for variable, of in variables.items():
            ET.SubElement(node, "pVariable", Name=variable).text = of
        _children(node, Formula=formula)

    def product(self, name: str, first: str, second: str) -> None:
        """Add an integer that is the product of two others and can only be read."""
        node = self._feature("IntSwissKnife", name)
        for variable, of in (("A", first), ("B", second)):
            ET.SubElement(node, "pVariable", Name=variable).text = of
        _children(node, Formula="A * B")

    def choice(self, name: str, address: int, entries: Mapping[str, int], lock: str = "") -> None:
        """Add a choice of entries, by their values in the register.

        Args:
            name: name of the feature.
            address: its register.
            entries: values in the register, by the entries' names.
            lock: feature that locks this one while it is not 0; "" for none.
        """
        node = self._feature("Enumeration", name)
        _lock(node, lock)
        for entry, value in entries.items():
            _children(ET.SubElement(node, "EnumEntry", Name=entry), Value=value)
        _children(node, pValue=self._register(name, address))

    def switch(self, name: str, address: int) -> None:
        """Add a switch: 1 is on."""
        node = self._feature("Boolean", name)
        _children(node, pValue=self._register(name, address), OnValue=1, OffValue=0)

    def command(self, name: str, address: int, value: int) -> None:
        """Add a command that writes `value`."""
        node = self._feature("Command", name)
        _children(node, pValue=self._register(name, address), CommandValue=value)

    def remembered(
        self,
        *,
        exposure_mode: int,
        binning: tuple[int, int],
        reverse_x: int,
        gamma: int,
        chunks: int,
        user_set: int,
        load: int,
    ) -> None:
        """Add what cameras keep from one program to the next, at these addresses, and their user sets."""
        self.choice("ExposureMode", exposure_mode, {"Timed": 0, "TriggerWidth": 1})
        self.integer("BinningHorizontal", binning[0], 1, 4)
        self.integer("BinningVertical", binning[1], 1, 4)
        self.switch("ReverseX", reverse_x)
        self.switch("GammaEnable", gamma)
        self.switch("ChunkModeActive", chunks)
        self.choice("UserSetSelector", user_set, {"Default": 0, "UserSet1": 1})
        self.command("UserSetLoad", load, 1)

    def xml(self) -> str:
        """The description as XML."""
        if self._root.find("Port") is None:
            ET.SubElement(self._root, "Port", Name="Device")
        return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(self._root, "unicode")

    def _feature(self, kind: str, name: str) -> ET.Element:
        ET.SubElement(self._category, "pFeature").text = name
        return ET.SubElement(self._root, kind, Name=name)

    def _register(self, name: str, address: int, length: int = 4, access: str = "RW") -> str:
        node = ET.SubElement(self._root, "IntReg", Name=f"{name}Register")
        _children(
            node,
            Address=hex(address),
            Length=length,
            AccessMode=access,
            pPort="Device",
            Sign="Unsigned",
            Endianess=self._order,
        )
        return f"{name}Register"


def _lock(node: ET.Element, lock: str) -> None:
    if lock:
        _children(node, pIsLocked=lock)


def _children(node: ET.Element, **texts: object) -> None:
    for name, text in texts.items():
        ET.SubElement(node, name).text = str(text)


def _word(text: str) -> str:
    return "".join(each for each in text if each.isalnum() or each == "_")

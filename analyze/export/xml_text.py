"""XML text of URDF, SDF and MJCF files."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody
from analyze.export.provenance import provenance_text


def document(root: ET.Element, body: ExportBody) -> str:
    """Text of an XML document, with the provenance as a comment at the top."""
    root.insert(0, ET.Comment(provenance_text(body.provenance)))
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """A new element at the end of `parent`."""
    element = ET.SubElement(parent, tag, attributes)
    element.text = text
    return element

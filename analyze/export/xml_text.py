"""Build the XML text that URDF, SDF and MJCF files share: elements, and the whole document."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from analyze.export.body import ExportBody
from analyze.export.provenance import provenance_text


def document(root: ET.Element, body: ExportBody) -> str:
    """Text of an XML document, with the provenance (origin of the numbers) as a comment in its root.

    Args:
        root: root element, changed in place: the comment becomes its first child, and its content is
            indented.
        body: exported body, of which the provenance is taken.
    """
    root.insert(0, ET.Comment(provenance_text(body.provenance)))
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """Append a new XML element to `parent` and return the new element.

    Args:
        parent: element that is changed.
        tag: name of the new element.
        text: text of the new element; None for none.
        attributes: attributes of the new element.
    """
    element = ET.SubElement(parent, tag, attributes)
    element.text = text
    return element

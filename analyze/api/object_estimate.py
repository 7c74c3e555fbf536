"""Estimate of one object, the result of `analyze.estimate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

from analyze.api.mass_properties import CentreOfMass, InertiaTensor, PartMass
from analyze.api.tables import data_frame, html_table, text_table
from analyze.errors import ExportError
from analyze.export.body import inertial_of
from analyze.export.export_source import ExportInput
from analyze.export.formats import Format, why_misnamed
from analyze.export.write import write_body
from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.urdf_inertial import inertial_element

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from analyze.result.answer import Answer
    from analyze.types import Array
    from schemas.quantity import Quantity


class ObjectEstimate:
    """Estimate of one object: centre of mass, inertia tensor, region masses and verdict.

    Returned by `analyze.estimate`. Printed, it is a summary of one screen; in a notebook it shows as tables.
    Vectors and tensors are in O, the frame of the object's shape file.
    """

    def __init__(self, answer: Answer) -> None:
        self._answer = answer

    @property
    def name(self) -> str:
        """Name of the object, from the object file."""
        return self._answer.estimate.evidence.spec.name

    @property
    def mass(self) -> float:
        """Mass [kg] of the object without its markers, from the object file.

        If a marker (printed tag) that has a mass has no known pose, none is subtracted; all are included.
        """
        return self._answer.estimate.inertial.mass

    @property
    def mass_sd(self) -> float:
        """Standard deviation of the mass [kg], from the object file."""
        return self._answer.estimate.inertial.mass_sd

    @property
    def centre_of_mass(self) -> CentreOfMass:
        """Centre of mass (3,) [m] in the shape file's frame O, with covariance (3, 3) [m²].

        The result also states whether the strikes determine all three directions, and which one they do not.
        It is that of the object without its markers (printed tags). If a marker that has a mass has no known
        pose, none is subtracted: all are included.
        """
        com = self._answer.estimate.com
        return CentreOfMass(com.position, com.covariance, com.observed, com.unobserved_direction)

    @property
    def inertia(self) -> InertiaTensor:
        """Inertia tensor [kg m²] about the centre of mass in the axes of O, the shape file's frame.

        Each entry has its standard deviation, and states whether the strikes determine it or only the prior
        (assumption before any strike).
        """
        inertial = self._answer.estimate.inertial
        return InertiaTensor(inertial.inertia, inertial.inertia_sd, inertial.measured)

    @property
    def parameters_covariance(self) -> Array:
        """Covariance (10, 10) of the ten inertial parameters, SI units, in O, the shape file's frame.

        Order: mass; x, y, z of the centre of mass; Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass.
        """
        return self._answer.estimate.inertial.covariance

    @property
    def regions(self) -> tuple[PartMass, ...]:
        """Masses [kg] with intervals of the shell and of the interior on either side of a dividing plane.

        One entry per region; empty if the masses were not computed.
        """
        regions = self._answer.result.regions
        return () if regions is None else tuple(_part(each.name, each.mass) for each in regions.regions)

    @property
    def parts(self) -> tuple[PartMass, ...]:
        """Masses [kg] with intervals of the parts that the object file labels, one entry each.

        Empty if it has no labels, or if its label is of a filling (contents of a container).
        """
        parts = self._answer.result.parts
        return () if parts is None else tuple(_part(each.name, each.mass) for each in parts.parts)

    @property
    def verdict(self) -> tuple[str, ...]:
        """Sentences on what to trust, then what to doubt, last which strikes to repeat.

        Each begins with "trust", "doubt", "not determined", "not checked" or "repeat".
        """
        return tuple(self._answer.result.verdict or ())

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the recordings, the object file and the estimate, one text each; empty if none."""
        return tuple(warning.text for warning in self._answer.result.warnings)

    @property
    def answer(self) -> Answer:
        """Internal estimate and its Result document, both of which may change between versions."""
        return self._answer

    def urdf(self) -> str:
        """`<inertial>` element, as XML text, of a URDF link whose frame is the shape file's frame O.

        Raises:
            ExportError: the mass or the moments are not physically possible.
        """
        own = inertial_of(self._answer.result, self.name)
        element = inertial_element(own.mass, own.com, own.inertia)
        ET.indent(element)
        return ET.tostring(element, encoding="unicode")

    def report(self, output: str | Path) -> Path:
        """Write the report, one HTML file with the answer, its reasons and plots.

        Args:
            output: the HTML file; its folder must exist.

        Returns:
            Path of the file.

        Raises:
            RecordingError: a recording cannot be read again, or the virtual recordings hold different ground
                truths.
            OutputError: the file cannot be written.
        """
        from analyze.report.report import write_report
        from analyze.result.score import score_if_virtual

        output = Path(output)
        paths = [head.path for head in self._answer.estimate.evidence.recordings]
        write_report(self._answer, output, score_if_virtual(paths, self._answer))
        return output

    # The parameter bears the command line option's name.
    def export(self, output: str | Path, format: str = "urdf") -> tuple[Path, ...]:  # noqa: A002
        """Write shape and inertial parameters of the object for a simulator or ROS.

        The coefficient of friction that the rig file states is written too, if bodies of the format have one
        (sdf, mjcf, gazebo). The file is written aside, read back by another library and compared before it is
        put in place.

        Args:
            output: the file, or for gazebo the folder. A mesh is written beside the file, or in the folder,
                unless the shape is a box or cylinder, or the format is usd or ros.
            format: urdf, sdf, mjcf, usd, ros (a ROS 2 message, InertiaStamped) or gazebo (a model folder).

        Returns:
            Paths of the files written: `output`, then the mesh if there is one.

        Raises:
            ExportError: the format is unknown or does not match the suffix of `output`, the library that
                reads the format back is missing, the file differs when read back, or mass or moments are
                not physically possible.
            OutputError: the file cannot be written.
        """
        output = Path(output)
        if format not in {each.value for each in Format}:
            raise ExportError(f"format {format!r} is unknown: use {', '.join(each.value for each in Format)}")
        kind = Format(format)
        if (reason := why_misnamed(output, kind)) is not None:
            raise ExportError(reason)
        body = ExportInput.from_answer(self._answer).body(kind, self.name)
        return tuple(write_body(body, kind, output))

    def figures(self) -> dict[str, Figure]:
        """Figures of the report (matplotlib) by name: front, side, top, moments, regions, predictions.

        "predictions" (tipping angle of each strike, compared with that predicted from all others) is absent
        if no strike could be predicted.
        """
        from analyze.report.plots import moments_figure, projection_figures, regions_figure
        from analyze.report.prediction_plot import prediction_figure

        estimate = self._answer.estimate
        found = dict(zip(("front", "side", "top"), projection_figures(estimate), strict=True))
        found |= {"moments": moments_figure(estimate), "regions": regions_figure(estimate)}
        if estimate.predictions:
            found["predictions"] = prediction_figure(estimate.predictions)
        return found

    def strike_figure(self, strike_id: str) -> Figure:
        """Figure of one strike: tipping angle, fit and residual against time.

        Args:
            strike_id: id of the strike; of several recordings with the recording's number, as `2:s3.1`.

        Raises:
            KeyError: no strike has this id, or its marker could not be tracked.
        """
        from analyze.report.plots import strike_figure

        for motion in self._answer.estimate.evidence.motions:
            if motion.strike_id == strike_id and motion.angle is not None:
                return strike_figure(motion, f"strike {strike_id}: {motion.verdict.value.replace('_', ' ')}")
        raise KeyError(f"no strike {strike_id!r} with a tracked marker")

    def to_dict(self) -> dict[str, Any]:
        """Result document as a dict of JSON values; the entries that `analyze estimate --json` prints."""
        return self._answer.result.model_dump(mode="json")

    def to_json(self) -> str:
        """Result document as one line of JSON; the bytes that `analyze estimate --json` prints."""
        return self._answer.json()

    def to_dataframe(self) -> pd.DataFrame:
        """Estimated quantities as a pandas table, one scalar per row, in SI units.

        Columns: quantity (its name), value, sd (standard deviation), low95 and high95 (ends of the 95 %
        interval), unit, source ("measured" by the strikes, "prior": assumed before any strike, or "given" in
        the object file) and observed (False if no strike determines it).

        Raises:
            ImportError: pandas is not installed.
        """
        from analyze.report.report_tables import ANSWER_COLUMNS, answer_rows

        rows = answer_rows(self._answer.result)
        return data_frame([dict(zip(ANSWER_COLUMNS, row, strict=True)) for row in rows])

    def __repr__(self) -> str:
        """Text of several lines: mass, centre of mass, inertia tensor, masses of regions and parts, verdict.

        Regions are the shell and the interior on either side of a plane; parts are bodies labelled in the
        object file. At most eight sentences of the verdict are shown.
        """
        lines = [
            f"{self.name}, {1e3 * self.mass:.1f} g",
            repr(self.centre_of_mass),
            repr(self.inertia),
            text_table(_mass_rows(self.regions)),
            *(text_table(_mass_rows(self.parts)) for _ in self.parts[:1]),
            *self.verdict[:8],
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        com, inertia = self.centre_of_mass, self.inertia
        centre = [
            {"": axis, "centre of mass [mm]": f"{1e3 * value:z.2f} ± {1e3 * SIGMAS_95 * sd:.2f}"}
            for axis, value, sd in zip("xyz", com.position, com.sd, strict=True)
        ]
        unit = f"10^{inertia.power_of_ten} kg m²"
        tensor = [{"": name, unit: text, "source": source} for name, text, source in inertia.rows()]
        tables = [
            html_table(f"{self.name}, {1e3 * self.mass:.1f} g; intervals 95 %", centre),
            html_table("Inertia tensor about the centre of mass", tensor),
            html_table("Region masses", _mass_rows(self.regions)),
        ]
        if self.parts:
            tables.append(html_table("Labelled parts", _mass_rows(self.parts)))
        return "".join(tables)


def _part(name: str, mass: Quantity) -> PartMass:
    return PartMass(name, mass.as_scalar(), mass.interval_ends(), mass.observed)


def _mass_rows(parts: tuple[PartMass, ...]) -> list[dict[str, str]]:
    return [
        {
            "part": part.name,
            "mass [g]": f"{1e3 * part.mass:.1f}" if part.observed else "not observed",
            "95 % [g]": f"{1e3 * part.interval95[0]:.1f} to {1e3 * part.interval95[1]:.1f}",
        }
        for part in parts
    ]

"""The page on clusters prints the files in docs/examples/cluster; Kubernetes's schema admits the manifest."""

from __future__ import annotations

import copy
import os
import subprocess
import sys
from pathlib import Path

import kubernetes_validate
import pytest
from ruamel.yaml import YAML

from tests.broken_files import break_file
from tests.docs.pages import DOCS, text_of
from tests.places import ROOT
from tests.quick_archive import body_of, quick_session

FOLDER = DOCS / "examples" / "cluster"
VERSIONS = ("1.33", kubernetes_validate.latest_version())
"""first version with all of the manifest's fields in their final form, and newest with a schema here"""


@pytest.fixture
def manifest():
    return YAML(typ="safe").load(FOLDER / "kubernetes.yaml")


@pytest.mark.parametrize("version", VERSIONS)
def test_the_manifest_agrees_with_the_schema(manifest, version):
    assert kubernetes_validate.validate(manifest, version, strict=True) in version


def test_the_schema_refuses_an_unknown_field_and_a_wrong_type(manifest):
    for change in ({"backoffLimitPerIndexes": 4}, {"completions": "20"}):
        wrong = copy.deepcopy(manifest)
        wrong["spec"] |= change
        with pytest.raises(kubernetes_validate.ValidationError):
            kubernetes_validate.validate(wrong, VERSIONS[0], strict=True)


@pytest.mark.slow
def test_the_manifests_command_runs(manifest, tmp_path):
    """The shell's line of the pod, with the places of this test, for each of its shards."""
    archive, output = tmp_path / "archive", tmp_path / "results"
    archive.mkdir()
    whole = quick_session(tmp_path / "whole.mcap", body_of(0), 0, 1, packed=True).path
    for number in range(12):
        break_file(whole, archive, "cut", number)
    shell, option, line = manifest["spec"]["template"]["spec"]["containers"][0]["command"]
    line = line.replace("s3://archive", str(archive)).replace("/results", str(output))
    search = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for index in range(manifest["spec"]["completions"]):
        environment = os.environ | {
            "JOB_COMPLETION_INDEX": str(index),
            "PATH": search,
            "PYTHONPATH": str(ROOT),
        }
        subprocess.run([shell, option, line], env=environment, check=True, capture_output=True)
    assert len(list((output / "failures").iterdir())) == 12
    environment["JOB_COMPLETION_INDEX"] = "20"
    assert subprocess.run([shell, option, line], env=environment, check=False, capture_output=True).returncode


def test_the_page_prints_every_file():
    page = text_of(DOCS / "how-to" / "cluster.md")
    for path in FOLDER.iterdir():
        assert f"```{{literalinclude}} ../examples/cluster/{path.name}\n" in page


def test_the_array_has_as_many_tasks_as_it_has_shards():
    text = (FOLDER / "slurm_array.sh").read_text()
    assert "#SBATCH --array=1-20\n" in text
    assert "\nshards=20 " in text
    assert subprocess.run(["bash", "-n"], input=text, text=True, check=True)

"""Folders and files of the repository that tests read."""

from pathlib import Path

from schemas.document import SCHEMA_VERSION

ROOT = Path(__file__).resolve().parents[1]
RECORDINGS = ROOT / "recordings"
FIRST_SAMPLE = RECORDINGS / "sample-1.0.mcap"
"""the oldest sample: every later version reads it"""
SAMPLE = RECORDINGS / f"sample-{SCHEMA_VERSION}.mcap"
"""the sample of this schema version"""
OBJECTS = ROOT / "acquire" / "virtual" / "object_data"
CARTON = OBJECTS / "carton.toml"
PATTERN_CAMERA = ROOT / "tests" / "acquire" / "camera" / "pattern_camera.py"

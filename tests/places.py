"""Folders and files of the repository that tests read."""

from pathlib import Path

from schemas.document import SCHEMA_VERSION

ROOT = Path(__file__).resolve().parents[1]
RECORDINGS = ROOT / "recordings"
FIRST_SAMPLE = RECORDINGS / "sample-1.0.mcap"
"""oldest sample recording, which every later version must read"""
SAMPLE = RECORDINGS / f"sample-{SCHEMA_VERSION}.mcap"
"""sample recording of this schema version"""
OBJECTS = ROOT / "acquire" / "virtual" / "object_data"
CARTON = OBJECTS / "carton.toml"
PATTERN_CAMERA = ROOT / "tests" / "acquire" / "camera" / "pattern_camera.py"

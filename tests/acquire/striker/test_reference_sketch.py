"""The reference sketch of the striker protocol: it compiles, and its program strikes on a simulated AVR.

Needs Debian's gcc-avr, avr-libc and arduino-core-avr; to run it also libsimavr-dev, libelf-dev and gcc.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from acquire.clock.clock import SystemClock
from acquire.striker.base import StrikerState
from acquire.striker.serial_striker import SerialStriker
from schemas.rig import StrikerConfig
from tests.places import ROOT

SKETCH = ROOT / "docs/examples/striker-board/striker-board.ino"
CORE = Path("/usr/share/arduino/hardware/arduino/avr")
HARNESS = Path(__file__).parent / "avr/run_sketch.c"
FLAGS = [
    *("-Os", "-fno-exceptions", "-ffunction-sections", "-fdata-sections", "-mmcu=atmega328p"),
    *("-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_ARCH_AVR"),
    "-DDECIMAL_DIG=__DECIMAL_DIG__",  # lacks in avr-libc 2.0, and the core of 1.8.7 needs it
]
FLASH_BYTES, RAM_BYTES = 30_000, 1500
"""room for the program on an Uno beside boot loader and stack"""

pytestmark = pytest.mark.skipif(
    not (shutil.which("avr-g++") and CORE.is_dir()), reason="gcc-avr or arduino-core-avr is missing"
)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Program of the sketch, linked with Arduino's core, without a warning of the sketch's own."""
    folder = tmp_path_factory.mktemp("sketch")
    include = [f"-I{CORE}/cores/arduino", f"-I{CORE}/variants/standard"]
    cpp, c = ["avr-g++", *FLAGS, "-std=gnu++11", *include], ["avr-gcc", *FLAGS, "-std=gnu11", *include]
    sketch = [*cpp, "-Wall", "-Wextra", "-x", "c++", "-c", str(SKETCH), "-o", "sketch.o"]
    done = subprocess.run(sketch, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"{SKETCH}:" not in done.stderr  # the core's own headers do give warnings
    commands = []
    for source in sorted((CORE / "cores/arduino").iterdir()):
        if source.suffix in {".cpp", ".c"}:
            compiler = cpp if source.suffix == ".cpp" else c
            commands.append([*compiler, "-w", "-c", str(source), "-o", f"{source.name}.o"])
    for command in commands:
        subprocess.run(command, cwd=folder, check=True)
    objects = sorted(path.name for path in folder.glob("*.o"))
    link = ["avr-gcc", "-Os", "-Wl,--gc-sections", "-mmcu=atmega328p", "-o", "sketch.elf", *objects, "-lm"]
    subprocess.run(link, cwd=folder, check=True)
    return folder / "sketch.elf"


@pytest.fixture
def simulated(program: Path, tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Serial port of a simulated board that runs the program, and the file of what its pins did."""
    header = Path("/usr/include/simavr/sim_avr.h")
    if not (shutil.which("gcc") and header.exists()):
        pytest.skip("libsimavr-dev or gcc is missing")
    runner, pins = tmp_path / "run_sketch", tmp_path / "pins"
    build = ["gcc", "-O2", "-o", str(runner), str(HARNESS), f"-I{header.parent}", "-lsimavr", "-lelf"]
    subprocess.run(build, check=True)
    master, slave = os.openpty()
    tty.setraw(slave)
    with pins.open("w") as errors:
        process = subprocess.Popen([runner, program], stdin=master, stdout=master, stderr=errors)
    try:
        yield os.ttyname(slave), pins
    finally:
        process.kill()
        process.wait()
        os.close(master)
        os.close(slave)


def test_the_sketch_fits_an_uno(program: Path) -> None:
    sizes = subprocess.run(["avr-size", str(program)], capture_output=True, text=True, check=True).stdout
    text, data, bss = (int(number) for number in sizes.splitlines()[1].split()[:3])
    assert text + data < FLASH_BYTES
    assert data + bss < RAM_BYTES


def test_the_sketch_strikes_and_times_on_a_simulated_board(simulated: tuple[str, Path], heard: Any) -> None:
    """Drive on for the table's 8 to 40 ms; the sensor signals 80 ms after the drive was switched on."""
    port, pins = simulated
    config = StrikerConfig(kind="serial", port=port, speed_range_m_s=(0.1, 0.6))
    striker = SerialStriker(
        config, heard.samples.append, heard.events.append, heard.clocks.append, SystemClock()
    )
    striker.open()
    try:
        striker.home()
        for name, speed in (("s1", 0.1), ("s2", 0.6)):
            striker.arm()
            striker.cock()
            outcome = striker.strike(name, speed)
            assert outcome.contacts == 1
            assert outcome.contact_time_ns is not None
            after_s = 1e-9 * (outcome.contact_time_ns - outcome.released_ns)
            assert after_s == pytest.approx(0.080, abs=0.002)
        striker.arm()
        striker.stop()
        assert striker.state is StrikerState.DISARMED
    finally:
        striker.close()
    drive = [line.split() for line in pins.read_text().splitlines() if line.startswith("drive")][1:]
    assert [level for _, level, _ in drive] == ["1", "0", "1", "0"]
    cycles = [int(cycle) for _, _, cycle in drive]
    assert (cycles[1] - cycles[0]) / 16e6 == pytest.approx(0.008, abs=0.0002)
    assert (cycles[3] - cycles[2]) / 16e6 == pytest.approx(0.040, abs=0.0002)


def test_the_sketch_disarms_itself_in_silence(simulated: tuple[str, Path], heard: Any) -> None:
    port, pins = simulated
    config = StrikerConfig(kind="serial", port=port, speed_range_m_s=(0.1, 0.6))
    striker = SerialStriker(
        config, heard.samples.append, heard.events.append, heard.clocks.append, SystemClock()
    )
    striker.open()
    try:
        striker.home()
        striker.arm()
        striker._closing.set()  # nobody sends anything any more
        assert striker._idle is not None
        striker._idle.join(0.6)
        time.sleep(0.6)
        assert striker._link.status("state").state.value == "safe"
    finally:
        striker.close()
    assert "drive 1" not in pins.read_text()

"""Boards: simulated seconds a second of sketches, and what compiling costs.

    python benchmarks/bench_sketch.py [--quick] [--json FILE]

A polling sketch with two sonars and two H-bridges runs alone (goal 50 times real time), then with a laptop
program that asks at 9600 baud (goal 20). Two boards joined at 9600 baud run with encoders of 400 edges a
second (goal 10). Two steppers are polled at 900 steps a second each, up and down their ramps (goal 10), also
with encoders on another board (no goal). Two
tasks of FreeRTOS measure and drive, with a queue between them (goal 20). Both cores of an ESP32 work
without a pause (no goal: ten times as many basic blocks as an AVR, on each). A sketch is compiled, with an
empty cache and again (goals 5 s and 0.2 s). Needs a C++ compiler.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))  # the runs of boards without a server are those of the tests

from simmer_tui.sketch.sketch_robot import compile_set  # noqa: E402
from simmer_tui.sketch.wiring import wiring_of  # noqa: E402
from tests.sketch.rovers import (  # noqa: E402
    DRIVE,
    ENCODERS,
    JOINED,
    MOTORS,
    ROVER,
    ROVER_BY_LINK,
    SENSOR,
    Boards,
    made_set,
)

SONARS = "".join(
    f'[[sensors]]\nboard = "rover"\npart = "hc-sr04"\ncode = "{code}"\ntrig = {trig}\necho = {echo}\n'
    for code, trig, echo in (("u1", 8, 4), ("u2", 12, 11))
)
POLLING = (
    DRIVE
    + """
float range(int trig, int echo) {
  digitalWrite(trig, LOW); delayMicroseconds(2);
  digitalWrite(trig, HIGH); delayMicroseconds(10); digitalWrite(trig, LOW);
  return pulseIn(echo, HIGH, 30000) / 148.0;
}
void setup() {
  Serial.begin(9600);
  pinMode(8, OUTPUT); pinMode(4, INPUT); pinMode(12, OUTPUT); pinMode(11, INPUT);
}
void loop() {
  float ahead = range(8, 4), aside = range(12, 11);
  if (ahead > 0 && ahead < 8) drive(-120, 120); else drive(150, 140);
  if (Serial.available() == 0 || Serial.read() != 'u') return;
  Serial.print(ahead); Serial.print(','); Serial.println(aside);
}
"""
)
LAPTOP = """
import serial, time
port = serial.Serial("COM6", 9600, timeout=1)
begun = time.time()
while time.time() - begun < SECONDS:
    port.write(b"u")
    port.readline()
"""
TWO_BOARDS = JOINED.replace("edges_per_inch = 40", "edges_per_inch = 21")
"""About 9.4 and 7.7 in/s: 400 edges a second of both together."""
ROVER_JOINED = ROVER_BY_LINK.replace("drive(-200, 0)", "drive(-220, -180)")
STEPPERS = "".join(
    f'[[motors]]\nboard = "rover"\ndriver = "step_dir"\nstep = {step}\ndir = {step + 3}\n'
    f'steps_per_inch = 100\nwheel = "{wheel}"\n'
    for step, wheel in ((2, "left"), (3, "right"))
)
STEPPERS_JOINED = (
    JOINED.partition("[[wires]]")[0] + STEPPERS + ENCODERS.format(board="sensor").replace("= 40", "= 21")
)
STEPPING = """
#include <AccelStepper.h>
AccelStepper left(AccelStepper::DRIVER, 2, 5), right(AccelStepper::DRIVER, 3, 6);
int way = 1;
void setup() {
  left.setMaxSpeed(900); right.setMaxSpeed(900);
  left.setAcceleration(1500); right.setAcceleration(1500);
}
void loop() {
  if (!left.run() & !right.run()) { left.move(1500 * way); right.move(1500 * way); way = -way; }
}
"""


TASKS = (
    "#include <Arduino_FreeRTOS.h>\n#include <queue.h>\n"
    + DRIVE
    + """
QueueHandle_t ranges;
void measures(void*) {
  for (;;) {
    digitalWrite(8, HIGH); delayMicroseconds(10); digitalWrite(8, LOW);
    float ahead = pulseIn(4, HIGH, 30000) / 148.0;
    xQueueSend(ranges, &ahead, 0);
    vTaskDelay(2);
  }
}
void drives(void*) {
  float ahead;
  for (;;)
    if (xQueueReceive(ranges, &ahead, portMAX_DELAY))
      if (ahead > 0 && ahead < 8) drive(-120, 120); else drive(150, 140);
}
void setup() {
  pinMode(8, OUTPUT); pinMode(4, INPUT);
  ranges = xQueueCreate(4, sizeof(float));
  xTaskCreate(measures, "measures", 128, NULL, 1, NULL);
  xTaskCreate(drives, "drives", 128, NULL, 2, NULL);
}
void loop() {}
"""
)


CORES = """
volatile unsigned long counts[2];
void other(void*) { for (;;) counts[0]++; }
void setup() { xTaskCreatePinnedToCore(other, "other", 2000, NULL, 1, NULL, 0); }
void loop() { counts[1]++; digitalWrite(2, counts[1] & 1); }
"""


def alone(folder: Path, wiring: str, sketches: Mapping[str, str], seconds: float) -> dict[str, float]:
    """Times real time of boards without a program, by the real clock and by the processor's."""
    boards = Boards(made_set(folder, wiring, sketches))
    try:
        begun, cpu = time.perf_counter(), time.process_time()
        boards.run_to(seconds)
        real, own = time.perf_counter() - begun, time.process_time() - cpu
        exchanges = sum(each.process.exchanges for each in boards.robot.boards.values())
    finally:
        boards.close()
    return {"real": seconds / real, "own_cpu": seconds / own, "exchanges": exchanges / seconds}


def with_laptop(folder: Path, seconds: float) -> float:
    """Times real time with a laptop program, from the log's own real times."""
    made_set(folder, ROVER + MOTORS + SONARS, {"rover.ino": POLLING})
    program, log = folder / "laptop.py", folder / "run.jsonl"
    program.write_text(LAPTOP.replace("SECONDS", str(seconds)), "utf-8")
    words = ["--no-ui", "--quiet", "--sketch", str(folder), "--clock", "program", "--port", "0"]
    words += ["--seed", "1", "--log", str(log), "--run", f"{sys.executable} {program}"]
    subprocess.run([sys.executable, "-m", "simmer_tui", *words], check=True, cwd=ROOT)
    times = [
        (float(record["t"]), float(record["real"]))
        for record in map(json.loads, log.read_text("utf-8").splitlines())
        if record["kind"] == "wire"
    ]
    (first, began), (last, ended) = times[0], times[-1]
    return (last - first) / (ended - began)


def compiling(folder: Path) -> tuple[float, float]:
    """Seconds to compile a sketch with an empty cache, and again."""
    configuration = made_set(folder / "set", ROVER + MOTORS + SONARS, {"rover.ino": POLLING})
    wiring = wiring_of(configuration)
    assert wiring is not None
    took = []
    for _ in range(2):
        begun = time.perf_counter()
        compile_set(wiring, configuration.directory)
        took.append(time.perf_counter() - begun)
    return took[0], took[1]


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument("--json", type=Path, help="write the figures to a file")
    options = parser.parse_args()
    seconds = 10.0 if options.quick else 60.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["XDG_DATA_HOME"] = str(folder / "data")  # an empty cache
        first, again = compiling(folder / "compile")
        polling = alone(folder / "polling", ROVER + MOTORS + SONARS, {"rover.ino": POLLING}, seconds)
        joined = alone(folder / "two", TWO_BOARDS, {"sensor.ino": SENSOR, "rover.ino": ROVER_JOINED}, seconds)
        steppers = alone(folder / "steppers", ROVER + STEPPERS, {"rover.ino": STEPPING}, seconds)
        sketches = {"sensor.ino": SENSOR, "rover.ino": STEPPING}
        counted = alone(folder / "counted", STEPPERS_JOINED, sketches, seconds)
        tasks = alone(folder / "tasks", ROVER + MOTORS + SONARS, {"rover.ino": TASKS}, seconds)
        esp32 = ROVER.replace("uno", "esp32")
        cores = alone(folder / "cores", esp32, {"rover.ino": CORES}, seconds / 10)
        laptop = with_laptop(folder / "laptop", seconds)
    figures = {
        "compile_s": first,
        "compile_again_s": again,
        "polling": polling,
        "polling_with_laptop": laptop,
        "two_boards": joined,
        "steppers": steppers,
        "steppers_with_encoders": counted,
        "tasks": tasks,
        "esp32_cores": cores,
    }
    print(f"compile                 {first:6.2f} s (goal 5), again {again:.3f} s (goal 0.2)")
    for title, goal, made in (
        ("polling sketch alone", 50, polling),
        ("two boards, 400 edges/s", 10, joined),
        ("two steppers", 10, steppers),
        ("tasks with a queue", 20, tasks),
    ):
        speed = f"{made['real']:6.1f} times real time (goal {goal})"
        print(f"{title:24}{speed}, {made['own_cpu']:.1f} by our own processor time")
    speed = f"{counted['real']:6.1f} times real time, {counted['own_cpu']:.1f} by our own"
    print(f"steppers and encoders   {speed}, {counted['exchanges']:.0f} exchanges a second")
    print(f"two cores of an ESP32   {cores['real']:6.1f} times real time, {cores['own_cpu']:.1f} by our own")
    print(f"with a laptop program   {laptop:6.1f} times real time (goal 20)")
    if options.json:
        options.json.write_text(json.dumps(figures), "utf-8")


if __name__ == "__main__":
    main()

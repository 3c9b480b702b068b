"""The header for C and C++, compiled by every compiler here and driven against the simulator."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.in_process import simmer

FOLDER = Path(__file__).parents[1] / "scripts" / "c"
STRICT = ["-Wall", "-Wextra", "-pedantic", "-Werror"]
LANGUAGES = {
    "c99": ["cc", "-std=c99", *STRICT],
    "c99 and posix": ["cc", "-std=c99", "-D_POSIX_C_SOURCE=200112L", *STRICT],
    "gnu": ["cc", *STRICT],
    "c++11": ["c++", "-std=c++11", "-x", "c++", *STRICT],
}

PROGRAM = r"""
#include "simmer.h"

int main(void) {
    simmer_robot robot;
    double values[3], reply = 0;
    int code;
    const char *codes[] = {"u1", "c1", "u3"}, *wrong[] = {"u1", "q9", "u3"};
    if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) { puts(robot.error); return 1; }
    if (simmer_read(&robot, codes, 3, values) != SIMMER_OK) { puts(robot.error); return 2; }
    printf("%.9g %.9g %.9g\n", values[0], values[1], values[2]);
    code = simmer_read(&robot, wrong, 3, values);
    printf("%d %s\n", code, robot.error);
    code = simmer_drive(&robot, "d1", 2.5, &reply);
    printf("%d %d\n", code, isinf(reply) != 0);
    code = simmer_drive(&robot, "x9", 1, NULL);
    printf("%d %s\n", code, robot.error);
    simmer_believe(&robot, 12, 42, 0, 0.5);
    printf("%d\n", simmer_send(&robot, "a\nb", &reply));
    simmer_close(&robot);
    code = simmer_read(&robot, codes, 1, values);
    printf("%d %s\n", code, robot.error);
    return 0;
}
"""


def compiled(source: Path, language: str, target: Path) -> Path:
    compiler, *options = LANGUAGES[language]
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    command = [compiler, *options, "-I", str(FOLDER), "-o", str(target), str(source), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


def driven(program: str, *options: str) -> subprocess.CompletedProcess[str]:
    """A program run by the simulator."""
    ports = ["--port", "0", "--reply-port", "0", "--belief-port", "0"]
    return simmer("--no-ui", "--quiet", *ports, "--seed", "7", *options, "--run", program)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_header_compiles_without_a_warning_and_drives(language: str, tmp_path: Path) -> None:
    source = tmp_path / "program.c"
    source.write_text(PROGRAM)
    form = ["--reply-format", "float64"]
    done = driven(str(compiled(source, language, tmp_path / "program")), *form)
    lines = done.stdout.splitlines()
    assert (done.returncode, len(lines)) == (0, 6), done.stderr
    from simmer_tui import Simulator

    simulator = Simulator(seed=7)
    expected = [simulator.execute(code).reply for code in ("u1", "c1", "u3")]
    assert [float(word) for word in lines[0].split()] == pytest.approx(expected, rel=1e-8)
    assert lines[1] == "1 the robot knows no such sensor, or it is disabled: 'q9'"
    assert lines[2] == "0 1"
    assert lines[3].startswith("1 the robot refused it")
    assert lines[4] == "1"
    assert lines[5] == "2 the connection has ended; open the robot again"


BELIEVER = r"""
#include "simmer.h"

int main(void) {
    static float p[4 * 8 * 3], many[65536];
    const double bounds[] = {0, 0, 48, 24};
    simmer_robot robot;
    if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) { puts(robot.error); return 1; }
    p[(1 * 8 + 2) * 3 + 1] = 3;
    p[(1 * 8 + 2) * 3 + 2] = 1;
    simmer_believe_grid(&robot, p, 4, 8, 3, NULL);
    p[0] = 1;
    simmer_believe_grid(&robot, p, 4, 8, 1, bounds);
    many[65535] = 1;
    simmer_believe_grid(&robot, many, 256, 256, 1, NULL);
    simmer_drive(&robot, "d1", 1, NULL);
    simmer_close(&robot);
    return 0;
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("language", LANGUAGES)
def test_grids_in_c_arrive(language: str, tmp_path: Path) -> None:
    source, log = tmp_path / "program.c", tmp_path / "run.jsonl"
    source.write_text(BELIEVER)
    done = driven(str(compiled(source, language, tmp_path / "program")), "--log", str(log))
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    told = [line for line in lines if line["kind"] == "belief" and not line.get("again")]
    assert [line["believed"] for line in told] == [[30, 30, 120], [45, 3, 0], [95.81, 0.09, 0]]
    assert told[0]["grid"]["p_best"] == 0.75
    assert [line["grid"].get("headings", 1) for line in told] == [3, 1, 1]


SCANNER = r"""
#include "simmer.h"

int main(void) {
    simmer_robot robot;
    double ranges[360], few[2], reply = 0;
    const char *codes[] = {"sc"};
    int i, code, count = 0;
    if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) { puts(robot.error); return 1; }
    robot.reply_bytes = REPLY_BYTES;
    if (simmer_scan(&robot, "sc", ranges, 360, &count) != SIMMER_OK) { puts(robot.error); return 2; }
    printf("%d", count);
    for (i = 0; i < count; i++) printf(" %.9g", ranges[i]);
    code = simmer_scan(&robot, "sc", few, 2, &count);
    printf("\n%d %d\n", code, count);
    code = simmer_scan(&robot, "u1", ranges, 360, &count);
    printf("%d %d %s\n", code, count, robot.error);
    code = simmer_scan(&robot, "q9", ranges, 360, &count);
    printf("%d %s\n", code, robot.error);
    code = simmer_send(&robot, "sc-90", &reply);
    printf("%d %d\n", code, reply > 0);
    code = simmer_read(&robot, codes, 1, &reply);
    printf("%d %s\n", code, robot.error);
    return 0;
}
"""


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_scan_in_c(language: str, tmp_path: Path) -> None:
    form, width = ("float32", 4) if language == "gnu" else ("float64", 8)
    source = tmp_path / "program.c"
    source.write_text(f"#define REPLY_BYTES {width}\n{SCANNER}")
    options = ["--config", "lidar", "--reply-format", form]
    done = driven(str(compiled(source, language, tmp_path / "program")), *options)
    lines = done.stdout.splitlines()
    assert (done.returncode, len(lines)) == (0, 6), done.stderr
    from simmer_tui import Simulator, load

    count, *ranges = map(float, lines[0].split())
    expected = Simulator(load("lidar"), seed=7).execute("sc").ranges
    assert expected is not None
    assert count == len(expected)
    assert ranges == pytest.approx(expected.tolist(), rel=1e-6)
    assert lines[1] == f"0 {len(expected)}"
    assert lines[2] == "1 0 this is no lidar: 'u1'"
    assert lines[3] == "1 the robot knows no such lidar, or it is disabled: 'q9'"
    assert lines[4] == "0 1"
    assert lines[5].startswith("2 more came back than a number")
    assert "simmer_scan" in lines[5]


SLEEPER = r"""
#define SIMMER_TIMEOUT 1
#include "simmer.h"

int main(void) {
    simmer_robot robot;
    int code;
    if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) { puts(robot.error); return 1; }
    code = simmer_sleep(&robot, 1.5);
    printf("%d %s\n", code, robot.error);
    code = simmer_sleep(&robot, -1);
    printf("%d %s\n", code, robot.error);
    simmer_close(&robot);
    return 0;
}
"""


@pytest.mark.slow
def test_a_sleep_in_c_outlasts_the_time_that_other_replies_may_take(tmp_path: Path) -> None:
    source = tmp_path / "program.c"
    source.write_text(SLEEPER)
    done = driven(str(compiled(source, "c99", tmp_path / "program")), "--motion", "timed")
    assert done.stdout.splitlines() == ["0 ", "1 the robot has no command to wait: 'wt--1'"], done.stderr


@pytest.mark.slow
def test_the_sample_in_c_wanders_without_a_contact(tmp_path: Path) -> None:
    program = compiled(FOLDER / "wander.c", "gnu", tmp_path / "wander")
    log = tmp_path / "run.jsonl"
    done = driven(f"{program} 12", "--log", str(log))
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 12
    answer = json.loads(simmer("report", log, "--json").stdout)["run"]
    assert (answer["commands"], answer["contacts"]) == (4 * 12, 0)


def test_nobody_there_is_one_clear_line(tmp_path: Path) -> None:
    program = compiled(FOLDER / "wander.c", "gnu", tmp_path / "wander")
    environment = {"SIMMER_PORT": "1", "SIMMER_REPLY_PORT": "0"}
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 1
    assert done.stderr.startswith("wander: no simulator answers there")

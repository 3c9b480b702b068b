"""Programs that open a serial port, unchanged, in front of the simulated robot of a dialect."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.loader import find_set, init_set
from tests.in_process import simmer

DIALECT = """
[frame]
end = "\\n"
[reply]
end = "\\r\\n"
missing = "-1.00"
[robot]
busy = "replace"
[[command]]
match = "getData"
reply = "u1: {u1*cm:.2f}u2: {u2*cm:.2f}"
[[command]]
match = "w {n}"
do = "d1-{n*12/13}"
done = "ok {contact}"
[[command]]
match = "f"
do = "run d1"
[[command]]
match = "x"
do = "stop"
"""


def run(
    tmp_path: Path,
    program: str,
    *options: str,
    dialect: str = DIALECT,
    command: str = "python program.py",
) -> subprocess.CompletedProcess[str]:
    """A program in front of the default set's robot with a dialect; its log is run.jsonl."""
    if not (tmp_path / "set").exists():
        init_set(tmp_path / "set", find_set("default"))
    (tmp_path / "set/dialect.toml").write_text(dialect, "utf-8")
    (tmp_path / "program.py").write_text(textwrap.dedent(program), "utf-8")
    (tmp_path / "run.jsonl").unlink(missing_ok=True)
    words = ["--no-ui", "--belief-port", "0", "--config", "set", "--seed", "3", *options]
    command = command.replace("python", f'"{sys.executable}"', 1)
    return simmer(*words, "--log", "run.jsonl", "--run", command, cwd=tmp_path)


def log_of(tmp_path: Path) -> list[dict[str, Any]]:
    """The events, without what the system drew: real times and the numbers of ports."""
    lines = [json.loads(line) for line in (tmp_path / "run.jsonl").read_text("utf-8").splitlines()[1:]]
    kept = [line for line in lines if line["kind"] != "notice"]
    unsure = ("real", "client")
    return [{key: value for key, value in line.items() if key not in unsure} for line in kept]


POLLING = """
    import serial, time
    from serial.tools import list_ports
    print([port.device for port in list_ports.comports()])
    robot = serial.Serial("COM6", 9600, timeout=0.1)
    print(isinstance(robot, serial.Serial), robot.is_open, robot.baudrate)
    def ask(text):
        robot.reset_input_buffer()
        robot.write((text + "\\n").encode())
        while True:
            line = robot.readline()
            if line:
                return line.decode().strip()
    for _ in range(3):
        ahead = float(ask("getData").split("u2")[0].removeprefix("u1: "))
        print(ask("w %d" % (3 if ahead > 30 else 0)))
    robot.write(b"f\\n")
    time.sleep(0.5)
    robot.write(b"x\\n")
    time.sleep(0.2)
    robot.write(b"getData\\n")
    time.sleep(0.5)
    print(robot.in_waiting, len(robot.read(robot.in_waiting)), robot.in_waiting)
    robot.close()
    print(robot.is_open)
"""


@pytest.mark.slow
def test_a_program_with_a_serial_port_drives_unchanged_and_the_same_every_time(tmp_path: Path) -> None:
    first = run(tmp_path, POLLING, "--clock", "program")
    assert first.returncode == 0, first.stderr
    lines = first.stdout.splitlines()
    assert lines[:2] == ["['COM6']", "True True 9600"]
    assert lines[2:5] == ["ok 0"] * 3
    assert lines[5:] == ["21 21 0", "False"] or lines[5:] == ["20 20 0", "False"]
    log = log_of(tmp_path)
    wire = [(line["data"], line.get("reply", False)) for line in log if line["kind"] == "wire"]
    assert ("getData\n", False) in wire
    assert ("ok 0\r\n", True) in wire
    again = run(tmp_path, POLLING, "--clock", "program")
    assert again.stdout == first.stdout
    assert log_of(tmp_path) == log
    rerun = simmer("rerun", "run.jsonl", cwd=tmp_path)
    assert "every reply the same" in rerun.stdout


LIST = '[[command]]\nmatch = "g"\nreply = [' + ", ".join(['"abcdefgh\\n"'] * 36) + "]\n"


@pytest.mark.slow
def test_a_long_list_of_replies_takes_its_bytes_time_and_the_same_every_time(tmp_path: Path) -> None:
    program = """
        import serial, time
        robot = serial.Serial("COM6", 57600, timeout=2)
        began = time.perf_counter()
        for _ in range(40):
            robot.write(b"g\\n")
            for _ in range(36):
                assert robot.read(2) + robot.read(7) == b"abcdefgh\\n"
        print(round((time.perf_counter() - began) * 1e6))
    """
    took = {run(tmp_path, program, "--clock", "program", dialect=LIST).stdout for _ in range(3)}
    # Two bytes there and 324 back; a look at a clock costs 5 us.
    assert len(took) == 1
    assert int(took.pop()) == pytest.approx(40 * 326 * 10 / 57600 * 1e6, abs=1000)


@pytest.mark.slow
def test_printed_lines_have_the_same_times_every_time(tmp_path: Path) -> None:
    program = """
        import sys, time
        for count in range(30):
            print(count, flush=True)
            time.sleep(0.1)
            print("half", count, file=sys.stderr)
            time.sleep(0.1)
    """
    run(tmp_path, program, "--clock", "program")
    (ended,) = (line for line in log_of(tmp_path) if line["kind"] == "program")
    for name, begin in (("stdout", 2.0), ("stderr", 2.1)):
        times = [line["t"] for line in ended[name]]
        assert len(times) == 20
        assert times == pytest.approx([begin + 0.2 * each for each in range(len(times))])


@pytest.mark.slow
def test_by_the_real_clock_bytes_take_their_time(tmp_path: Path) -> None:
    program = """
        import serial, time
        with serial.Serial("/dev/ttyACM0", 9600, timeout=2) as robot:
            before = time.monotonic()
            robot.write(b"getData\\n")
            line = robot.readline()
            # Ten bits a byte: 8 there and the line back.
            print(time.monotonic() - before >= (8 + len(line)) * 10 / 9600 - 0.001, line[:4])
    """
    assert run(tmp_path, program).stdout.strip() == "True b'u1: '"


@pytest.mark.slow
def test_one_program_drives_and_a_second_is_refused(tmp_path: Path) -> None:
    program = """
        import serial
        first = serial.Serial("COM6")
        try:
            serial.Serial("COM7", timeout=1)
        except serial.SerialException as error:
            print(error)
        first.close()
        try:
            first.read()
        except serial.SerialException as error:
            print(type(error).__name__)
        print(serial.Serial("COM7", timeout=0).read())
    """
    ended = run(tmp_path, program, "--clock", "program")
    assert ended.stdout.splitlines() == [
        "could not open port 'COM7': Access is denied.",
        "PortNotOpenError",
        "b''",
    ]
    assert "a program opened COM7 while another one has COM6 open: it was refused" in ended.stderr


@pytest.mark.slow
def test_only_the_named_ports_are_the_robots(tmp_path: Path) -> None:
    program = """
        import serial
        from serial.tools import list_ports
        print([port.device for port in list_ports.comports()])
        try:
            serial.Serial("COM5")
        except serial.SerialException as error:
            print(error)
        print(serial.Serial("COM8").name)
    """
    ended = run(tmp_path, program, "--serial-names", "COM6,COM8", "--clock", "program")
    assert ended.stdout.splitlines() == [
        "['COM6', 'COM8']",
        "could not open port 'COM5': there is only COM6, COM8",
        "COM8",
    ]


def test_what_a_program_does_wrong_is_told(tmp_path: Path) -> None:
    program = """
        import serial
        robot = serial.Serial("COM6", 115200, timeout=0.2)
        robot.write(b"getdata\\n")
        print(robot.readline())
        robot.write(b"getDa")
        robot.close()
    """
    ended = run(tmp_path, program, "--clock", "program")
    assert ended.stdout.strip() == "b''"
    assert "'getdata' is no message of the dialect; 'getData' differs in case" in ended.stderr
    assert "5 bytes dropped, a message without its end: 'getDa'" in ended.stderr


@pytest.mark.slow
def test_a_read_that_can_never_end_is_told_with_its_line(tmp_path: Path) -> None:
    program = """
        import serial
        robot = serial.Serial("COM6")
        robot.write(b"getdata\\n")
        robot.read()
    """
    ended = run(tmp_path, program, "--clock", "program")
    assert ended.returncode == 2
    assert (
        "program.py:5: the program waits for a reply that never comes; it wrote b'getdata\\n' last"
        in ended.stderr
    )
    assert "'getdata' is no message of the dialect; 'getData' differs in case" in ended.stderr


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("clock", ["program", "real"])
@pytest.mark.parametrize("closes", [True, False])
def test_replies_that_nobody_read_are_told(tmp_path: Path, clock: str, *, closes: bool) -> None:
    program = f"""
        import serial, time
        robot = serial.Serial("COM6", 115200, timeout=5)
        robot.write(b"getData\\n")
        while robot.in_waiting < 20:
            time.sleep(0.01)
        robot.read(4)
        {"robot.close()" if closes else ""}
    """
    ended = run(tmp_path, program, "--clock", clock)
    assert ended.returncode == 0, ended.stderr
    assert "the program left 1" in ended.stderr
    assert "bytes of replies unread" in ended.stderr


@pytest.mark.slow
def test_a_stream_holds_up_nothing(tmp_path: Path) -> None:
    stream = '[[stream]]\nevery = 0.004\nsend = "{tick},{u1:.1f}"\n'
    program = """
        import serial, time
        robot = serial.Serial("COM6", 115200, timeout=0.05)
        end, count = time.monotonic() + 5, 0
        while time.monotonic() < end:
            while robot.in_waiting:
                count += len(robot.readline()) > 0
            time.sleep(0.01)
        print(count)
    """
    ended = run(tmp_path, program, "--clock", "program", dialect=DIALECT + stream)
    assert 1200 <= int(ended.stdout) <= 1260
    wire = [line for line in log_of(tmp_path) if line["kind"] == "wire"]
    assert len(wire) == 1000


COURSE_PROGRAM = """
    import serial, struct, time
    robot = serial.Serial("COM6", 9600, timeout=5)
    before = time.monotonic()
    robot.write({first})
    print({read})
    robot.write({second})
    print({read})
    print(time.monotonic() - before > 0.3)
"""


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("kind", "first", "second", "read", "printed"),
    [
        (
            "packets",
            'b"[u1,zz]"',
            'b"[d1-3,t1]"',
            'robot.read_until(b"]")',
            r"b'\[u1:\d+\.\d+,zz:Not Found\]'",
        ),
        (
            "binary9000",
            'b"u1\\n"',
            'b"d1-3\\n"',
            'struct.unpack(">d", robot.read(8))[0] > 3',
            "True",
        ),
    ],
)
def test_a_protocol_of_the_course_needs_no_rules(
    kind: str, first: str, second: str, read: str, printed: str, tmp_path: Path
) -> None:
    program = COURSE_PROGRAM.format(first=first, second=second, read=read)
    ended = run(tmp_path, program, "--clock", "program", dialect=f'[frame]\nkind = "{kind}"\n')
    lines = ended.stdout.splitlines()
    assert re.fullmatch(printed, lines[0]), ended.stderr
    # Packets are answered at once, numbers at the end of the movement.
    assert lines[2] == str(kind == "binary9000")
    wire = [line for line in log_of(tmp_path) if line["kind"] == "wire"]
    assert [line.get("reply", False) for line in wire] == [False, True, False, True]
    assert wire[2]["meaning"].startswith("d1-3")


def test_a_protocol_of_the_course_has_nothing_beside_it(tmp_path: Path) -> None:
    ended = run(tmp_path, "", dialect='[frame]\nkind = "packets"\nend = "x"\n[[command]]\nmatch = "a"\n')
    assert "dialect.toml:3:frame.end: has no meaning beside kind" in ended.stderr
    assert "dialect.toml:4:command: has no meaning beside kind" in ended.stderr


@pytest.mark.slow
def test_the_report_counts_messages_with_the_nearest_to_an_unknown_one(tmp_path: Path) -> None:
    program = """
        import serial
        with serial.Serial("COM6", 115200, timeout=0.05) as robot:
            for text in (b"getdata", b"getData", b"getdata", b"w 1"):
                robot.write(text + b"\\n")
                robot.readline()
    """
    assert run(tmp_path, program, "--clock", "program").returncode == 0
    ended = simmer("report", "run.jsonl", "--json", cwd=tmp_path)
    messages = json.loads(ended.stdout)["messages"]
    assert messages[0] == {"message": "getdata", "sent": 2, "text": "unknown; 'getData' differs in case"}
    assert {each["message"]: each["sent"] for each in messages[1:]} == {"getData": 1, "w {n}": 1}


BRACKETS = """
[frame]
kind = "bracket"
[reply]
end = "\\r\\n"
[[command]]
match = "h"
reply = "[+]"
"""


@pytest.mark.slow
@pytest.mark.parametrize("clock", ["real", "program"])
def test_the_line_end_behind_a_bracket_can_be_read_with_it(tmp_path: Path, clock: str) -> None:
    program = """
        import serial
        robot = serial.Serial("COM6", 115200, timeout=2)
        answers = set()
        for _ in range(50):
            robot.read(robot.in_waiting)
            robot.write(b"[h]")
            answer = b""
            while not answer.endswith(b"]"):
                answer += robot.read(1)
            answers.add((answer, robot.in_waiting))
        print(answers)
    """
    ended = run(tmp_path, program, "--clock", clock, dialect=BRACKETS)
    assert ended.stdout.strip() == "{(b'[+]', 2)}", ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("program", ["robot.readline()", "robot.write(b'v\\n'); robot.readline()"])
def test_what_goes_over_the_line_counts_as_something_sent(tmp_path: Path, program: str) -> None:
    rules = '[[stream]]\nevery = 0.1\nsend = "s{tick}\\n"\n[[command]]\nmatch = "v"\nreply = "1.0\\n"\n'
    text = f"import serial\nrobot = serial.Serial('COM6', 115200, timeout=1)\n{program}\nrobot.close()\n"
    ended = run(tmp_path, text, "--clock", "program", dialect=rules)
    assert (ended.returncode, "nothing was sent" in ended.stderr) == (0, False), ended.stderr
    assert "Failed" not in ended.stdout + ended.stderr
    told = simmer("report", "run.jsonl", cwd=tmp_path).stdout
    assert "sent no command" not in told
    assert "connection to the simulator" not in told


THREADS_AT_A_PORT = """
import serial, serial.threaded, threading, time
robot = serial.Serial("COM6", 115200)
said = []
def note(what): said.append((what, round(time.monotonic(), 3)))
def listen():
    while line := robot.readline():
        note(line)
    note("cancelled")
thread = threading.Thread(target=listen)
thread.start()
for _ in range(5):
    robot.write(b"getData\\n")
    time.sleep(0.07)
    note(robot.in_waiting)
robot.cancel_read()
thread.join()
class Lines(serial.threaded.LineReader):
    TERMINATOR = b"\\n"
    def handle_line(self, line): note(line)
with serial.threaded.ReaderThread(robot, Lines) as lines:
    lines.write_line("getData")
    time.sleep(0.2)
print(*said, sep="\\n")
"""


TICKS = '\n[[stream]]\nevery = 0.05\nsend = "s{tick}\\n"\n'


def test_a_thread_waits_for_the_port_while_another_writes(tmp_path: Path) -> None:
    ended = run(tmp_path, THREADS_AT_A_PORT, "--clock", "program", dialect=DIALECT + TICKS)
    assert ended.returncode == 0, ended.stderr
    said = ended.stdout.splitlines()
    assert sum("b's" in each for each in said) == 7  # in 0.35 s, each 0.05 s
    assert sum("u1: " in each for each in said) == 6
    assert [each for each in said if "cancelled" in each] == ["('cancelled', 0.351)"]


@pytest.mark.slow
def test_ten_runs_of_threads_at_a_port_are_the_same(tmp_path: Path) -> None:
    runs = {
        run(tmp_path, THREADS_AT_A_PORT, "--clock", "program", dialect=DIALECT + TICKS).stdout
        for _ in range(10)
    }
    assert len(runs) == 1


@pytest.mark.slow
def test_what_is_left_of_a_stream_is_no_fault(tmp_path: Path) -> None:
    rules = '[[stream]]\nevery = 0.01\nsend = "s{tick}\\n"\n'
    program = """
        import serial, time
        robot = serial.Serial("COM6", 115200, timeout=1)
        robot.readline()
        time.sleep(0.5)
        robot.close()
    """
    ended = run(tmp_path, program, "--clock", "program", dialect=rules)
    assert "nothing went wrong" in ended.stderr


@pytest.mark.slow
def test_a_program_that_was_not_led_is_not_told_of_its_own_line(tmp_path: Path) -> None:
    program = "import serial\nrobot = serial.Serial('/nowhere/COM6')\n"
    (tmp_path / "isolated.sh").write_text("exec python -I program.py\n", "utf-8")
    ended = run(tmp_path, program, command="sh isolated.sh")
    assert "s, the program was not connected to the robot's serial port: " in ended.stderr, ended.stderr
    assert "mend the error in program.py" not in ended.stderr


@pytest.mark.slow
def test_a_run_that_pressed_against_a_wall_has_met_something(tmp_path: Path) -> None:
    rules = '[[command]]\nmatch = "{way:w=w1|s=s1} {ms}"\ndo = "run {way} for {ms/1000} s"\n'
    rules += 'done = "{contact}\\n"\n'
    program = """
        import serial
        robot = serial.Serial("COM6", 115200, timeout=9)
        for message in b"w 100", b"w 2000", b"w 100", b"s 100":
            robot.write(message + b"\\n")
            print(robot.readline())
    """
    ended = run(tmp_path, program, "--clock", "program", dialect=rules)
    assert ended.stdout.split() == ["b'0\\n'", "b'1\\n'", "b'1\\n'", "b'0\\n'"]


@pytest.mark.slow
def test_a_contact_names_the_message_of_the_program(tmp_path: Path) -> None:
    rules = '[[command]]\nmatch = "[{ms}]"\ndo = "run d1 for {ms/1000} s"\n'
    rules += '[[command]]\nmatch = "w {n}"\ndo = "d1-{n}"\n'
    program = """
        import serial, time
        robot = serial.Serial("COM6", 115200, timeout=1)
        robot.write(b"[90000]\\n")
        time.sleep(100)
        robot.write(b"w 60\\n")
        time.sleep(60)
    """
    ended = run(tmp_path, program, "--clock", "program", dialect=rules)
    assert "contact: [90000] (vv-6;0;0;90) " in ended.stderr
    assert "contact: w 60 (d1-60) " in ended.stderr
    told = simmer("report", "run.jsonl", cwd=tmp_path).stdout
    assert "w 60 (d1-60)" in told

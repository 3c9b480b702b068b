"""The subcommand `ports`."""

from __future__ import annotations

import argparse
import sys

from simmer_tui.cli.exit_codes import ExitCode, command
from simmer_tui.cli.json_output import add_json_option, print_json
from simmer_tui.cli.options import OneLineParser
from simmer_tui.links import port_list


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="simmer-tui ports", description="List the serial ports of this machine.")
    add_json_option(parser)
    return parser


@command(_parser)
def run_ports(options: argparse.Namespace) -> int:
    """`simmer-tui ports`: the serial ports, one a line. Returns the exit code."""
    ports = port_list.list_ports()
    if options.json:
        print_json(ports)
        return ExitCode.DONE if ports else ExitCode.NO
    if not ports:
        sys.stderr.write(
            "no serial port found: plug the robot in, or pair it and connect its Bluetooth port first\n"
        )
        return ExitCode.NO
    width = max(len(port.device) for port in ports)
    for port in ports:
        mark = f"[{port.mark}]" if port.mark else ""
        sys.stdout.write("  ".join(filter(None, (port.device.ljust(width), mark, port.description))).rstrip())
        sys.stdout.write("\n")
    return ExitCode.DONE

"""`simmer-tui ports`: the serial ports that a robot may be on."""

from __future__ import annotations

import argparse

from simmer_tui.cli.command_line import ExitCode, add_json_option, print_json, print_lines, say, subcommand
from simmer_tui.document.model import DataColumn, Document, data_table
from simmer_tui.links import port_list

PORTS = data_table(
    "ports", "Serial ports", DataColumn("device"), DataColumn("description"), DataColumn("leads_to")
)


@subcommand("ports", add_json_option)
def run_ports(options: argparse.Namespace) -> int:
    """List the serial ports of this machine."""
    ports = port_list.list_ports()
    if options.json:
        rows = [(port.device, port.description, port.mark) for port in ports]
        print_json(Document("Serial ports", [PORTS.filled(rows)]))
    elif ports:
        width = max(len(port.device) for port in ports)
        for port in ports:
            mark = f"[{port.mark}]" if port.mark else ""
            shown = "  ".join(filter(None, (port.device.ljust(width), mark, port.description)))
            print_lines(shown.rstrip())
    else:
        say("no serial port found: plug the robot in, or pair it and connect its Bluetooth port first")
    return ExitCode.DONE if ports else ExitCode.NO

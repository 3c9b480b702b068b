"""One table of dialects: the languages that programs speak to the robot, and the ports they need.

A new dialect is three files: its codec `links/protocol/NAME.py`, its link `links/NAME_link.py`, and its row
here. The server, the options, the settings, the variables of programs, `check` and `doctor` use this table.
"""

from msgspec import Struct

# The default limit of Linux (net.core.somaxconn), which cuts it where it is lower. Packet clients open a
# connection per message: 128 were full after 30 ms of a busy machine.
BACKLOG = 4096
"""Most connections to a port that wait in the system until they are accepted."""
# All connections that wait on the reply port are accepted before a client's first reply. 128 take 15 ms;
# 4,096 took 0.35 s, and more descriptors than the 1024 that a process has by default.
REPLY_BACKLOG = 128
"""Most connections to the reply port of the binary dialects that wait in the system until they are
accepted."""


class DialectPort(Struct, frozen=True):
    """A port of a dialect. `setting` is its name in `[server]`."""

    purpose: str
    setting: str
    default: int
    help: str
    backlog: int = BACKLOG

    @property
    def variable(self) -> str:
        """The environment variable with its number, for programs."""
        return f"SIMMER_{self.setting.upper()}"

    @property
    def option(self) -> str:
        """The option that sets it."""
        return "--" + self.setting.replace("_", "-")


class Dialect(Struct, frozen=True):
    """A row of the table.

    `link` is the function `(LinkContext) -> Link` that serves the ports, and `typed` the function
    `(text, ServerSettings) -> (bytes, ReplyForm)` that writes a command as programs do. Both are
    `module:name`, since only served dialects are imported. `summary` is its line in `check`, with the
    settings of `[server]` in braces. A dialect without `typed` is always served, in addition to those with
    commands. If its port is not available, the robot is still served, with `warning`.
    """

    ports: tuple[DialectPort, ...]
    link: str
    summary: str
    typed: str = ""
    warning: str = ""


# 9000 and 9001 are those of the MATLAB simulator since 2020, 61200 and 61201 those of simmer-python since
# 2023: programs have them written into their code.
COMMANDS = DialectPort("commands", "port", 9000, "port for commands, 0: any free")
REPLIES = DialectPort(
    "replies", "reply_port", 9001, "port that sends replies, 0 for any free one", REPLY_BACKLOG
)
PACKETS = DialectPort("packets", "packet_port", 61200, "port that takes packets, 0 for any free one")
PACKET_REPLIES = DialectPort(
    "packet replies", "packet_reply_port", 61201, "port that sends the replies to packets, 0 for any free one"
)
# Only of this simulator: the next port after the MATLAB ones.
BELIEFS = DialectPort("beliefs", "belief_port", 9002, "port where programs send their beliefs, 0 for any")

# The next port of this simulator. It is fixed, so that an IDE's settings (`simmer-tui env`) stay right.
SERIAL = DialectPort("serial", "dialect_port", 9003, "port of programs that open a serial port, 0 for any")

TEAM = "dialect"
"""The name of the team's own language, which a set with a `DIALECT_FILE` has."""
DIALECT_FILE = "dialect.toml"
"""The file of a set that describes the team's own language."""
DIALECTS: dict[str, Dialect] = {
    # First in the table, so that typed commands are written as MATLAB programs write them, unless only
    # packets are served.
    "binary": Dialect(
        (COMMANDS, REPLIES),
        "simmer_tui.links.binary_link:BinaryLink",
        "Binary: commands on port {port}, replies on port {reply_port}, {reply_format} {byte_order}-endian.",
        "simmer_tui.links.protocol.binary:typed",
    ),
    "packets": Dialect(
        (PACKETS, PACKET_REPLIES),
        "simmer_tui.links.packet_link:PacketLink",
        "Packets: requests on port {packet_port}, replies on port {packet_reply_port}; without brackets "
        "answered in {legacy_reply}.",
        "simmer_tui.links.protocol.packets:typed",
    ),
    TEAM: Dialect(
        (SERIAL,),
        "simmer_tui.links.dialect_link:DialectLink",
        "Dialect: dialect.toml, for programs that open a serial port; line speed: {line}. Motion is timed.",
        "simmer_tui.links.protocol.binary:typed",
    ),
    # Without `typed`: it has no commands, so that it is not a choice of `listeners`.
    "beliefs": Dialect(
        (BELIEFS,),
        "simmer_tui.links.belief_link:BeliefLink",
        "Server: {host}, beliefs on port {belief_port}.",
        warning="no beliefs will be shown",
    ),
}
"""The dialects by name, as in `listeners`. The first one served writes typed commands."""


def choices() -> tuple[str, ...]:
    """The dialects that `listeners` may name."""
    return tuple(name for name, dialect in DIALECTS.items() if dialect.typed)


def served(listeners: tuple[str, ...]) -> tuple[Dialect, ...]:
    """The dialects of a server, in the order of the table."""
    return tuple(each for name, each in DIALECTS.items() if name in listeners or not each.typed)


def all_ports() -> tuple[DialectPort, ...]:
    """The ports of all dialects."""
    return tuple(port for dialect in DIALECTS.values() for port in dialect.ports)

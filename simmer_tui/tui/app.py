"""The terminal app: the screen of a live run, with a console to take part in it."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.events import Event, Key
from textual.screen import Screen
from textual.widget import Widget

from simmer_tui.config.dialects import COMMANDS
from simmer_tui.config.examples import EXAMPLE, example_command
from simmer_tui.errors import ProgramError
from simmer_tui.live.server import Server
from simmer_tui.live.snapshot import Snapshot
from simmer_tui.sim.specs import DriveKind
from simmer_tui.tui import answers
from simmer_tui.tui.event_text import REASONS, ends_with_answer, refusal_of
from simmer_tui.tui.headline import RunPhase
from simmer_tui.tui.help import CommandProvider
from simmer_tui.tui.key_table import (
    AGAIN_KEY,
    EXAMPLE_KEY,
    IN_CONSOLE,
    TRY_KEY,
    Hint,
    MazePane,
    drive_keys,
    hints_of,
    keymap,
    maze_hints,
)
from simmer_tui.tui.key_velocity import PERIOD, KeyVelocity
from simmer_tui.tui.line_panel import LinePanel, between, shortened
from simmer_tui.tui.readouts import Room, last_reply, status_line
from simmer_tui.tui.screen_orders import OrderingShell
from simmer_tui.tui.shell import put
from simmer_tui.tui.sizes import BRIEF_ANSWER, Box
from simmer_tui.tui.terminal import TerminalChoice
from simmer_tui.tui.textual_internals import age_of

_PROMPT = 5
"""Columns by which typed text is longer than the reply beside it, on a small screen."""
# These have an order or a key of their own here.
_REPLACED = ("Screenshot", "Keys", "Maximize", "Minimize", "Quit")


class SimmerApp(OrderingShell):
    """The screen of a live run: keys that drive, and a console."""

    TITLE = "SimMeR"
    COMMANDS = {CommandProvider}  # noqa: RUF012
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("colon", "colon", priority=True),
        Binding("enter", "focus_console", priority=True),
        Binding(EXAMPLE_KEY.lower(), "example"),
        Binding(AGAIN_KEY, "again", priority=True),
        Binding(TRY_KEY, "try_changes", priority=True),
    ]

    def __init__(
        self, server: Server, choice: TerminalChoice, history_file: Path | None = None, *, program: str = ""
    ) -> None:
        """`program` is the name of the run's own program, or empty."""
        super().__init__(server, choice, MazePane(choice.glyphs, choice.color), history_file)
        self._console.free_keys = {
            AGAIN_KEY: partial(self._over, self.action_again),
            TRY_KEY: partial(self._over, self.action_try_changes),
        }
        self._prompt = LinePanel(id="prompt")
        self._reply = LinePanel(id="reply")
        self._held_key = KeyVelocity(self._operator, server)
        self.run_program: Callable[[str], None] | None = None
        """Starts a program beside the run; None where there may be none, as beside another."""
        self.run_again: Callable[[], None] = partial(self.action_press, "reset")
        """Restarts the run."""
        self._panes.pointer = " ".join(REASONS)
        self._panes.slot.first_steps = self._first_steps
        self._panes.slot.has_orders = True
        self._panes.slot.tries = bool(program)
        self._panes.program_name = program

    # -- putting together ------------------------------------------------------------------------

    def controls(self) -> Iterable[Widget]:
        return self._head, self._console, self._prompt, self._reply

    def on_mount(self) -> None:
        self.set_keymap(keymap(self._settings.keys))
        self._console.focus_line()
        self.paste_target = self._console.line
        for warning in self.server.warnings:
            self._operator.hint(warning)
        if self._settings.screen.keys_velocity:
            self.set_interval(PERIOD, self._held_key.pass_time)

    def shown(self, snapshot: Snapshot, since: int) -> None:
        self._operator.note_block(snapshot.state)
        refusal = refusal_of(snapshot.entries, since)
        if refusal is not None:
            self._console.show_refusal(refusal)
        elif any(entry.number > since and not entry.folds for entry in snapshot.entries):
            self._console.note_event()

    def show_status(self, snapshot: Snapshot) -> None:
        brief = "events" not in self._plan.boxes
        entries = self._panes.log.entries if brief else ()
        status = status_line(snapshot, entries, brief=brief, plain=self._plain)
        answer = self._panes.answer
        is_free = not ends_with_answer(entries, self._panes.slot.asked_at)
        if brief and is_free and "answer" in self._plan.boxes and answer is not None and answer.covers:
            # The third of its lines: the other two take the rows of legend and pose.
            lines = answer.shown(Room(self.size.width, BRIEF_ANSWER, self._plain))
            status = lines[2][1:] if len(lines) > 2 else ()
        reply = last_reply(snapshot)
        self._console.show_status(status, () if brief else reply)
        room = self._reply.size.width
        if room:
            self._reply.show([between((), shortened(reply, room - 1), room)])

    def _arrange(self, width: int, height: int) -> None:
        super()._arrange(width, height)
        typed = self._console.has_focus_within
        self._show_head("console", "" if typed else ": or Enter comes here")
        console = self._plan.boxes.get("console")
        # Without events the line above shows the present movement, and the last reply is beside the typed
        # text.
        room = console.width // 2 - _PROMPT if console is not None and "events" not in self._plan.boxes else 0
        self._prompt.display, self._reply.display = console is not None, room > 0
        if console is not None:
            put(self._prompt, Box(console.x + 1, console.y + 1, 1, 1))
            self._prompt.show([((">", "title"),)])
            self._console.line.styles.width = console.width - room if room > 0 else "1fr"
            put(self._reply, Box(console.x + console.width - room, console.y + 1, max(room - 1, 1), 1))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave keys to pages and text fields that have a use of their own for them."""
        if action in ("colon", "again", "try_changes", "focus_console"):
            is_elsewhere = len(self.screen_stack) == 1 and not self._console.has_focus_within
            after_end = action in ("again", "try_changes")
            return is_elsewhere and (not after_end or self._panes.phase.is_over)
        return super().check_action(action, parameters)

    def _first_steps(self) -> answers.AnswerCard:
        sketches = self.server.sketches
        if sketches is not None:
            return answers.board_steps(has_line=sketches.wiring.laptop is not None)
        drives = [drive for drive in self._spec.drives if drive.enabled]
        drives.sort(key=lambda drive: drive.kind is not DriveKind.RIGHT)  # forward, if it can
        command = f"{drives[0].code}-3" if drives else "u1"
        key = EXAMPLE_KEY if self._can_run_example else ""
        port = self.server.ports.get(COMMANDS.purpose)
        variable = "" if port in (None, COMMANDS.default) else f"{COMMANDS.variable}={port}"
        return answers.first_steps(key, command, drive_keys(self._settings.keys), variable)

    @property
    def _can_run_example(self) -> bool:
        """True while a simulated robot, on the ports that the sample program knows, waits for a program. One
        with boards is not driven by it."""
        server = self.server
        is_simulated = server.robot is None and server.sketches is None and self._settings.sim
        is_waiting = self._panes.phase is RunPhase.WAITING
        return (
            self.run_program is not None and is_simulated and is_waiting and COMMANDS.purpose in server.ports
        )

    def action_example(self) -> None:
        """Run the sample program, if a robot waits for one."""
        if not self._can_run_example or self.run_program is None:
            return
        try:
            self.run_program(example_command())
        except ProgramError as error:
            self._console.show_error(str(error))
        else:
            self.run_program = None
            self._panes.program_name = EXAMPLE

    def action_again(self) -> None:
        """Restart the run after its end, and its program with it."""
        self._panes.slot.close()
        self._console.forget_errors()
        self.run_again()
        self.refresh_frame()

    def _over(self, act: Callable[[], object]) -> bool:
        """Do an action for a run that is over, by the key for it in an empty console."""
        if self._panes.phase.is_over:
            act()
            return True
        return False

    def page_turned(self) -> None:
        if not self._console.has_focus_within:
            self.action_focus_pane()

    def hints(self) -> Sequence[Hint]:
        if self._console.has_focus_within:
            return hints_of(IN_CONSOLE)
        return maze_hints(self._settings.keys) if self._maze.has_focus else super().hints()

    # -- what people do --------------------------------------------------------------------------

    def action_order(self, line: str) -> None:
        """Do an order as if it were typed in the console."""
        self._console.give(line)

    def action_colon(self) -> None:
        """Begin an order; the next typed text belongs to it."""
        self._console.focus_line(":")

    def action_begin_order(self, line: str) -> None:
        """Put the beginning of an order into the console."""
        self._console.focus_line(line)

    async def on_event(self, event: Event) -> None:
        """End the velocity of a held key at any other key, before the action of that key."""
        if isinstance(event, Key) and not event.is_forwarded:
            self._held_key.note_key(event.key if self._maze.has_focus else "", age_of(event))
        await super().on_event(event)

    def action_drive(self, name: str, fine: bool) -> None:
        """Drive or turn by a key's step."""
        self._console.forget_errors()
        by_velocity = self._settings.screen.keys_velocity
        self._console.show_error((self._held_key if by_velocity else self._operator).drive(name, fine))
        self.refresh_frame()

    def action_focus_console(self) -> None:
        self._console.focus_line()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Textual's own commands, without those that have an order here."""
        theirs = super().get_system_commands(screen)
        return [each for each in theirs if each.title not in _REPLACED]

"""Bytes around a line of text that its author did not write: marks of an encoding, telnet's options, NULs."""

import re

# Sent by .NET's StreamWriter, PowerShell and MATLAB before the first text of a stream, or of each message.
_MARK = b"\xef\xbb\xbf"
# RFC 854 and 855: a command, an option with its answer, a subnegotiation. Of IANA's options, clients send
# those below 48, which are no letters or digits.
_TELNET = re.compile(rb"\xff(?:\xfa.*?\xff\xf0|[\xfb-\xfe][\x00-\x2f]|[\xf0-\xf9])", re.DOTALL)


def without_marks(text: bytes) -> bytes:
    """A line or message without marks in front, NULs and telnet's options, if the rest is plain text."""
    if text.isascii() and b"\0" not in text:
        return text
    rest = _rest(text)
    return rest if rest.isascii() and rest.strip() else text


def has_marks_alone(text: bytes) -> bool:
    """True if a text is nothing but marks, or telnet's options: its author has written nothing yet."""
    return not text.isascii() and not _rest(text)


def _rest(text: bytes) -> bytes:
    text = _TELNET.sub(b"", text).replace(b"\0", b"")
    while text.startswith(_MARK):
        text = text[len(_MARK) :]
    return text

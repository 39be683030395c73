"""A serial port of this computer as a transport of eskin/live/link.py."""

import os
import select
import termios
from pathlib import Path

import serial

from eskin.golden.core import InputError
from eskin.live.link import LinkError

WRITE_TIMEOUT_S, READ_BYTES = 10.0, 1 << 12
GONE = "the port went away while it was in use: look at cable and board, then start again"


class SerialPort:
    """8 data bits, no parity, 1 stop bit, no handshake; for this process alone.

    Parameters
    ----------
    name:
        /dev/ttyUSB0, say.
    baud:
        Bits a second.

    Raises
    ------
    InputError
        It cannot be opened; it does not know the rate.
    """

    def __init__(self, name: str, baud: int) -> None:
        # opened for writing before it is found out to be none
        if Path(name).exists() and not Path(name).is_char_device():
            raise InputError(f"--port {name}: is not a serial port; give the board's, such as /dev/ttyUSB1")
        try:
            self._port = serial.Serial(name, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except (OSError, termios.error) as error:
            reason = os.strerror(error.args[0]) if len(error.args) > 1 else error
            raise InputError(
                f"--port {name}: cannot be opened ({reason}); give the board's port, close programs that use it, and on "
                "Debian join the group dialout"
            ) from None
        except ValueError as error:
            raise InputError(
                f"--port {name}: does not know the bitstream's rate, {baud} bit/s ({error}); use another adapter"
            ) from None

    def write(self, data: bytes) -> None:
        """Send all of ``data``. LinkError if the port has disappeared or no longer accepts data."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException:
            raise LinkError(
                f"the port took no bytes for {WRITE_TIMEOUT_S:.0f} s: look at the board"
            ) from None
        except OSError:
            raise LinkError(GONE) from None

    def read(self, timeout_s: float) -> bytes:
        """Received bytes; waits for the first byte, at most ``timeout_s``. LinkError if the port is gone."""
        try:
            select.select([self._port], [], [], timeout_s)
            return self._port.read(READ_BYTES)
        except OSError:
            raise LinkError(GONE) from None

    def close(self) -> None:
        """Give the port back."""
        self._port.close()

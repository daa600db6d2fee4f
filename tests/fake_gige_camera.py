"""A GigE Vision camera without hardware: Aravis' own fake one, in a process on the loopback interface."""

import subprocess
import sys
from pathlib import Path

from zeromethod.drivers.aravis_library import LIBRARY

ADDRESS = "127.0.0.1"

# Its pixels are (row + 2 column) mod 251, or the pictures of a file (n, rows, columns) in turn.
_PROGRAM = f"""
import ctypes, itertools, sys
import numpy as np
lib = ctypes.CDLL("{LIBRARY}")
P = ctypes.c_void_p
def function(name, result, *arguments):
    f = getattr(lib, name)
    f.restype, f.argtypes = result, arguments
    return f
FILL = ctypes.CFUNCTYPE(None, P, P, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32)
get_data = function("arv_buffer_get_data", P, P, ctypes.POINTER(ctypes.c_size_t))
width = function("arv_buffer_get_image_width", ctypes.c_int, P)
height = function("arv_buffer_get_image_height", ctypes.c_int, P)
pictures = itertools.cycle(np.load(sys.argv[1])) if len(sys.argv) > 1 else None
def fill(buffer, _data, _exposure, _gain, pixel_format):
    size = ctypes.c_size_t()
    data = get_data(buffer, ctypes.byref(size))
    if pictures is not None:
        image = next(pictures)
    else:
        image = (np.arange(height(buffer))[:, None] + 2 * np.arange(width(buffer))) % 251
        image = image.astype(np.uint8) if pixel_format == 0x01080001 else (257 * image).astype(np.uint16)
    ctypes.memmove(data, image.ctypes.data, image.nbytes)
fill = FILL(fill)
camera = function("arv_gv_fake_camera_new", P, ctypes.c_char_p, ctypes.c_char_p)(b"{ADDRESS}", b"GV01")
fake = function("arv_gv_fake_camera_get_fake_camera", P, P)(camera)
function("arv_fake_camera_set_fill_pattern", None, P, FILL, P)(fake, fill, None)
print(function("arv_gv_fake_camera_is_running", ctypes.c_int, P)(camera), flush=True)
sys.stdin.read()
"""


class FakeGigECamera:
    """The process that plays the camera. pictures: .npy file of what it shows, uint8 (n, rows, columns)."""

    def __init__(self, pictures: Path | None = None) -> None:
        self._arguments = [] if pictures is None else [str(pictures)]
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        command = [sys.executable, "-c", _PROGRAM, *self._arguments]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout.readline().strip() == "1", "the fake camera did not start"

    def kill(self) -> None:
        if self._process is not None:
            with self._process as process:
                process.kill()
            self._process = None

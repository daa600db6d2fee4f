"""What other programs open: a recording's maps, mesh, track, messages and video.

from zeromethod.export import Selection, prepare
from zeromethod.recording.recording import Recording

with Recording("session.h5") as recording:
    print(prepare(recording, Path("depth.tif"), selection=Selection(from_s=1.0, to_s=2.0)).write())
"""

from zeromethod.export.formats import FORMATS, MESHES, SUFFIXES, Export, form_of, prepare
from zeromethod.export.selection import SelectedSteps, Selection

__all__ = ["FORMATS", "MESHES", "SUFFIXES", "Export", "SelectedSteps", "Selection", "form_of", "prepare"]

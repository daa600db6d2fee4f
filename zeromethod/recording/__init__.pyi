from .file import check_new
from .recorder import Recorder
from .recording import Recording, open_recording
from .schema import KEEP
from .source import DamagedWarning

__all__ = ["KEEP", "DamagedWarning", "Recorder", "Recording", "check_new", "open_recording"]

from .calibration.folder import Stored
from .commissioning.calibration.calibrate import calibrate
from .commissioning.calibration.evaluation import Calibration
from .commissioning.calibration.new_rig import Calipers, rig_text
from .commissioning.calibration.storing import store_calibration
from .commissioning.daily_check.check import check_bench
from .commissioning.daily_check.findings import DailyCheck
from .commissioning.decode import decode
from .commissioning.delay import DelayResult, measure_delay
from .commissioning.setting_up import SettingUp
from .contact.pressure import PressureMap, pressure_map
from .decoding.measuring import RestMeasurement
from .design.assess import assess_rig
from .devices.opening import Devices, open_devices
from .drivers.identify import identify
from .drivers.listing import cameras
from .drivers.monitors import monitors
from .errors import InputError, MeasurementError
from .export.formats import export_recording
from .fine.surface import FineSurface
from .loop.events import Event
from .loop.loop import Loop
from .loop.state import State
from .loop.step import Step
from .optics.bench import Optics
from .paper.reproduce import Reproduction, reproduce
from .passive.measure import Measurement, StillReading, measure
from .recording.recording import Recording, open_recording
from .rig.binning import binned
from .rig.load import load_rig
from .rig.model import Rig
from .session.replay.replay import replay
from .session.result import RunResult
from .session.session import Session
from .session.summary import summarise
from .session.whole_run import run
from .study.results import Results, run_study
from .surface.peak import Peak, peak
from .surface.reader import SurfaceReader
from .surface.surface import Surface
from .thread_limits import limit_threads
from .view.figure import plot_run
from .view.report import report
from .view.surface_figure import plot
from .warp.grid import NodeGrid
from .warp.warp import Warp

__version__: str

__all__ = [
    "Calibration",
    "Calipers",
    "DailyCheck",
    "DelayResult",
    "Devices",
    "Event",
    "FineSurface",
    "InputError",
    "Loop",
    "Measurement",
    "MeasurementError",
    "NodeGrid",
    "Optics",
    "Peak",
    "PressureMap",
    "Recording",
    "Reproduction",
    "RestMeasurement",
    "Results",
    "Rig",
    "RunResult",
    "Session",
    "SettingUp",
    "State",
    "Step",
    "StillReading",
    "Stored",
    "Surface",
    "SurfaceReader",
    "Warp",
    "__version__",
    "assess_rig",
    "binned",
    "calibrate",
    "cameras",
    "check_bench",
    "decode",
    "export_recording",
    "identify",
    "limit_threads",
    "load_rig",
    "measure",
    "measure_delay",
    "monitors",
    "open_devices",
    "open_recording",
    "peak",
    "plot",
    "plot_run",
    "pressure_map",
    "replay",
    "report",
    "reproduce",
    "rig_text",
    "run",
    "run_study",
    "store_calibration",
    "summarise",
]

from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class FrameMeta(_message.Message):
    __slots__ = ("sequence", "device_time_ns", "host_time_ns", "mid_exposure_host_ns", "exposure_us", "frame_id", "frames_lost_before", "image_recorded", "width", "height", "mapping_sd_ns")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    DEVICE_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    MID_EXPOSURE_HOST_NS_FIELD_NUMBER: _ClassVar[int]
    EXPOSURE_US_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    FRAMES_LOST_BEFORE_FIELD_NUMBER: _ClassVar[int]
    IMAGE_RECORDED_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    MAPPING_SD_NS_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    device_time_ns: int
    host_time_ns: int
    mid_exposure_host_ns: int
    exposure_us: float
    frame_id: int
    frames_lost_before: int
    image_recorded: bool
    width: int
    height: int
    mapping_sd_ns: int
    def __init__(self, sequence: _Optional[int] = ..., device_time_ns: _Optional[int] = ..., host_time_ns: _Optional[int] = ..., mid_exposure_host_ns: _Optional[int] = ..., exposure_us: _Optional[float] = ..., frame_id: _Optional[int] = ..., frames_lost_before: _Optional[int] = ..., image_recorded: bool = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., mapping_sd_ns: _Optional[int] = ...) -> None: ...

class ClockSample(_message.Message):
    __slots__ = ("clock", "device_time_ns", "host_before_ns", "host_after_ns")
    CLOCK_FIELD_NUMBER: _ClassVar[int]
    DEVICE_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_BEFORE_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_AFTER_NS_FIELD_NUMBER: _ClassVar[int]
    clock: str
    device_time_ns: int
    host_before_ns: int
    host_after_ns: int
    def __init__(self, clock: _Optional[str] = ..., device_time_ns: _Optional[int] = ..., host_before_ns: _Optional[int] = ..., host_after_ns: _Optional[int] = ...) -> None: ...

class StrikerSample(_message.Message):
    __slots__ = ("host_before_ns", "host_after_ns", "tick_ms", "position_rad", "velocity_rad_s", "current_a")
    HOST_BEFORE_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_AFTER_NS_FIELD_NUMBER: _ClassVar[int]
    TICK_MS_FIELD_NUMBER: _ClassVar[int]
    POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    CURRENT_A_FIELD_NUMBER: _ClassVar[int]
    host_before_ns: int
    host_after_ns: int
    tick_ms: int
    position_rad: float
    velocity_rad_s: float
    current_a: float
    def __init__(self, host_before_ns: _Optional[int] = ..., host_after_ns: _Optional[int] = ..., tick_ms: _Optional[int] = ..., position_rad: _Optional[float] = ..., velocity_rad_s: _Optional[float] = ..., current_a: _Optional[float] = ...) -> None: ...

class StrikerEvent(_message.Message):
    __slots__ = ("kind", "host_time_ns", "time_sd_ns", "strike_id", "tip_speed_m_s", "tip_speed_sd_m_s", "impulse_n_s", "impulse_sd_n_s", "text")
    class Kind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        KIND_UNSPECIFIED: _ClassVar[StrikerEvent.Kind]
        HOMED: _ClassVar[StrikerEvent.Kind]
        ARMED: _ClassVar[StrikerEvent.Kind]
        COCKED: _ClassVar[StrikerEvent.Kind]
        RELEASED: _ClassVar[StrikerEvent.Kind]
        CONTACT: _ClassVar[StrikerEvent.Kind]
        MISSED: _ClassVar[StrikerEvent.Kind]
        CAUGHT: _ClassVar[StrikerEvent.Kind]
        VERIFIED: _ClassVar[StrikerEvent.Kind]
        DISARMED: _ClassVar[StrikerEvent.Kind]
        FAULT: _ClassVar[StrikerEvent.Kind]
        STOPPED: _ClassVar[StrikerEvent.Kind]
    KIND_UNSPECIFIED: StrikerEvent.Kind
    HOMED: StrikerEvent.Kind
    ARMED: StrikerEvent.Kind
    COCKED: StrikerEvent.Kind
    RELEASED: StrikerEvent.Kind
    CONTACT: StrikerEvent.Kind
    MISSED: StrikerEvent.Kind
    CAUGHT: StrikerEvent.Kind
    VERIFIED: StrikerEvent.Kind
    DISARMED: StrikerEvent.Kind
    FAULT: StrikerEvent.Kind
    STOPPED: StrikerEvent.Kind
    KIND_FIELD_NUMBER: _ClassVar[int]
    HOST_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    TIME_SD_NS_FIELD_NUMBER: _ClassVar[int]
    STRIKE_ID_FIELD_NUMBER: _ClassVar[int]
    TIP_SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    TIP_SPEED_SD_M_S_FIELD_NUMBER: _ClassVar[int]
    IMPULSE_N_S_FIELD_NUMBER: _ClassVar[int]
    IMPULSE_SD_N_S_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    kind: StrikerEvent.Kind
    host_time_ns: int
    time_sd_ns: float
    strike_id: str
    tip_speed_m_s: float
    tip_speed_sd_m_s: float
    impulse_n_s: float
    impulse_sd_n_s: float
    text: str
    def __init__(self, kind: _Optional[_Union[StrikerEvent.Kind, str]] = ..., host_time_ns: _Optional[int] = ..., time_sd_ns: _Optional[float] = ..., strike_id: _Optional[str] = ..., tip_speed_m_s: _Optional[float] = ..., tip_speed_sd_m_s: _Optional[float] = ..., impulse_n_s: _Optional[float] = ..., impulse_sd_n_s: _Optional[float] = ..., text: _Optional[str] = ...) -> None: ...

class SessionState(_message.Message):
    __slots__ = ("state", "strike_id", "attempt", "text", "toss_id")
    class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        STATE_UNSPECIFIED: _ClassVar[SessionState.State]
        IDLE: _ClassVar[SessionState.State]
        PLACING: _ClassVar[SessionState.State]
        CHECKING_POSE: _ClassVar[SessionState.State]
        ARMING: _ClassVar[SessionState.State]
        STRIKING: _ClassVar[SessionState.State]
        RECORDING: _ClassVar[SessionState.State]
        JUDGING: _ClassVar[SessionState.State]
        FINISHED: _ClassVar[SessionState.State]
        ABORTED: _ClassVar[SessionState.State]
        TOSSING: _ClassVar[SessionState.State]
    STATE_UNSPECIFIED: SessionState.State
    IDLE: SessionState.State
    PLACING: SessionState.State
    CHECKING_POSE: SessionState.State
    ARMING: SessionState.State
    STRIKING: SessionState.State
    RECORDING: SessionState.State
    JUDGING: SessionState.State
    FINISHED: SessionState.State
    ABORTED: SessionState.State
    TOSSING: SessionState.State
    STATE_FIELD_NUMBER: _ClassVar[int]
    STRIKE_ID_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    TOSS_ID_FIELD_NUMBER: _ClassVar[int]
    state: SessionState.State
    strike_id: str
    attempt: int
    text: str
    toss_id: str
    def __init__(self, state: _Optional[_Union[SessionState.State, str]] = ..., strike_id: _Optional[str] = ..., attempt: _Optional[int] = ..., text: _Optional[str] = ..., toss_id: _Optional[str] = ...) -> None: ...

class StrikeRecord(_message.Message):
    __slots__ = ("strike_id", "plan_strike_id", "attempt", "window_start_ns", "window_end_ns", "contact_time_ns", "contact_time_sd_ns", "tip_speed_command_m_s", "tip_speed_m_s", "verdict_code", "verdict_text", "energy_ratio", "R_world_object", "p_world_object", "impact_height_m", "choice_text", "T_world_camera")
    STRIKE_ID_FIELD_NUMBER: _ClassVar[int]
    PLAN_STRIKE_ID_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    WINDOW_START_NS_FIELD_NUMBER: _ClassVar[int]
    WINDOW_END_NS_FIELD_NUMBER: _ClassVar[int]
    CONTACT_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    CONTACT_TIME_SD_NS_FIELD_NUMBER: _ClassVar[int]
    TIP_SPEED_COMMAND_M_S_FIELD_NUMBER: _ClassVar[int]
    TIP_SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    VERDICT_CODE_FIELD_NUMBER: _ClassVar[int]
    VERDICT_TEXT_FIELD_NUMBER: _ClassVar[int]
    ENERGY_RATIO_FIELD_NUMBER: _ClassVar[int]
    R_WORLD_OBJECT_FIELD_NUMBER: _ClassVar[int]
    P_WORLD_OBJECT_FIELD_NUMBER: _ClassVar[int]
    IMPACT_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    CHOICE_TEXT_FIELD_NUMBER: _ClassVar[int]
    T_WORLD_CAMERA_FIELD_NUMBER: _ClassVar[int]
    strike_id: str
    plan_strike_id: str
    attempt: int
    window_start_ns: int
    window_end_ns: int
    contact_time_ns: int
    contact_time_sd_ns: float
    tip_speed_command_m_s: float
    tip_speed_m_s: float
    verdict_code: str
    verdict_text: str
    energy_ratio: float
    R_world_object: _containers.RepeatedScalarFieldContainer[float]
    p_world_object: _containers.RepeatedScalarFieldContainer[float]
    impact_height_m: float
    choice_text: str
    T_world_camera: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, strike_id: _Optional[str] = ..., plan_strike_id: _Optional[str] = ..., attempt: _Optional[int] = ..., window_start_ns: _Optional[int] = ..., window_end_ns: _Optional[int] = ..., contact_time_ns: _Optional[int] = ..., contact_time_sd_ns: _Optional[float] = ..., tip_speed_command_m_s: _Optional[float] = ..., tip_speed_m_s: _Optional[float] = ..., verdict_code: _Optional[str] = ..., verdict_text: _Optional[str] = ..., energy_ratio: _Optional[float] = ..., R_world_object: _Optional[_Iterable[float]] = ..., p_world_object: _Optional[_Iterable[float]] = ..., impact_height_m: _Optional[float] = ..., choice_text: _Optional[str] = ..., T_world_camera: _Optional[_Iterable[float]] = ...) -> None: ...

class TossRecord(_message.Message):
    __slots__ = ("toss_id", "plan_toss_id", "attempt", "window_start_ns", "window_end_ns", "verdict_code", "verdict_text")
    TOSS_ID_FIELD_NUMBER: _ClassVar[int]
    PLAN_TOSS_ID_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    WINDOW_START_NS_FIELD_NUMBER: _ClassVar[int]
    WINDOW_END_NS_FIELD_NUMBER: _ClassVar[int]
    VERDICT_CODE_FIELD_NUMBER: _ClassVar[int]
    VERDICT_TEXT_FIELD_NUMBER: _ClassVar[int]
    toss_id: str
    plan_toss_id: str
    attempt: int
    window_start_ns: int
    window_end_ns: int
    verdict_code: str
    verdict_text: str
    def __init__(self, toss_id: _Optional[str] = ..., plan_toss_id: _Optional[str] = ..., attempt: _Optional[int] = ..., window_start_ns: _Optional[int] = ..., window_end_ns: _Optional[int] = ..., verdict_code: _Optional[str] = ..., verdict_text: _Optional[str] = ...) -> None: ...

class TruthPose(_message.Message):
    __slots__ = ("world_time_ns", "p_world_object", "q_world_object_wxyz", "linear_velocity", "angular_velocity", "striker_angle_rad", "striker_velocity_rad_s")
    WORLD_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    P_WORLD_OBJECT_FIELD_NUMBER: _ClassVar[int]
    Q_WORLD_OBJECT_WXYZ_FIELD_NUMBER: _ClassVar[int]
    LINEAR_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    STRIKER_ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
    STRIKER_VELOCITY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    world_time_ns: int
    p_world_object: _containers.RepeatedScalarFieldContainer[float]
    q_world_object_wxyz: _containers.RepeatedScalarFieldContainer[float]
    linear_velocity: _containers.RepeatedScalarFieldContainer[float]
    angular_velocity: _containers.RepeatedScalarFieldContainer[float]
    striker_angle_rad: float
    striker_velocity_rad_s: float
    def __init__(self, world_time_ns: _Optional[int] = ..., p_world_object: _Optional[_Iterable[float]] = ..., q_world_object_wxyz: _Optional[_Iterable[float]] = ..., linear_velocity: _Optional[_Iterable[float]] = ..., angular_velocity: _Optional[_Iterable[float]] = ..., striker_angle_rad: _Optional[float] = ..., striker_velocity_rad_s: _Optional[float] = ...) -> None: ...

class TruthContact(_message.Message):
    __slots__ = ("world_time_ns", "impulse_n_s", "p_world_contact", "duration_s")
    WORLD_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    IMPULSE_N_S_FIELD_NUMBER: _ClassVar[int]
    P_WORLD_CONTACT_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    world_time_ns: int
    impulse_n_s: float
    p_world_contact: _containers.RepeatedScalarFieldContainer[float]
    duration_s: float
    def __init__(self, world_time_ns: _Optional[int] = ..., impulse_n_s: _Optional[float] = ..., p_world_contact: _Optional[_Iterable[float]] = ..., duration_s: _Optional[float] = ...) -> None: ...

class TruthBody(_message.Message):
    __slots__ = ("mass_kg", "com_object", "inertia_com", "edge_radius_m", "region_mass_kg", "region_plane", "shell_thickness_m", "friction", "table_tilt_x_rad", "table_tilt_y_rad", "T_camera_world", "seed", "drag_coefficient")
    MASS_KG_FIELD_NUMBER: _ClassVar[int]
    COM_OBJECT_FIELD_NUMBER: _ClassVar[int]
    INERTIA_COM_FIELD_NUMBER: _ClassVar[int]
    EDGE_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    REGION_MASS_KG_FIELD_NUMBER: _ClassVar[int]
    REGION_PLANE_FIELD_NUMBER: _ClassVar[int]
    SHELL_THICKNESS_M_FIELD_NUMBER: _ClassVar[int]
    FRICTION_FIELD_NUMBER: _ClassVar[int]
    TABLE_TILT_X_RAD_FIELD_NUMBER: _ClassVar[int]
    TABLE_TILT_Y_RAD_FIELD_NUMBER: _ClassVar[int]
    T_CAMERA_WORLD_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    DRAG_COEFFICIENT_FIELD_NUMBER: _ClassVar[int]
    mass_kg: float
    com_object: _containers.RepeatedScalarFieldContainer[float]
    inertia_com: _containers.RepeatedScalarFieldContainer[float]
    edge_radius_m: float
    region_mass_kg: _containers.RepeatedScalarFieldContainer[float]
    region_plane: _containers.RepeatedScalarFieldContainer[float]
    shell_thickness_m: float
    friction: float
    table_tilt_x_rad: float
    table_tilt_y_rad: float
    T_camera_world: _containers.RepeatedScalarFieldContainer[float]
    seed: int
    drag_coefficient: float
    def __init__(self, mass_kg: _Optional[float] = ..., com_object: _Optional[_Iterable[float]] = ..., inertia_com: _Optional[_Iterable[float]] = ..., edge_radius_m: _Optional[float] = ..., region_mass_kg: _Optional[_Iterable[float]] = ..., region_plane: _Optional[_Iterable[float]] = ..., shell_thickness_m: _Optional[float] = ..., friction: _Optional[float] = ..., table_tilt_x_rad: _Optional[float] = ..., table_tilt_y_rad: _Optional[float] = ..., T_camera_world: _Optional[_Iterable[float]] = ..., seed: _Optional[int] = ..., drag_coefficient: _Optional[float] = ...) -> None: ...

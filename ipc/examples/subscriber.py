"""One line per frame of a session, read where the server wrote it. Needs iceoryx2==0.10.0 and numpy."""

import ctypes, os, sys
import iceoryx2 as iox2
import numpy as np


class GaussianState(ctypes.Structure):
    _fields_ = [("position", ctypes.c_float * 3), ("color", ctypes.c_uint8 * 4),
                ("covariance", ctypes.c_float * 6), ("object", ctypes.c_uint32),
                ("index", ctypes.c_uint32), ("rotation", ctypes.c_float * 4)]

    @staticmethod
    def type_name() -> str:
        return "cosplat.v1.GaussianState"


class FrameHeader(ctypes.Structure):
    _fields_ = [("step", ctypes.c_uint64), ("sim_time", ctypes.c_double), ("dt", ctypes.c_double),
                ("epoch", ctypes.c_uint64), ("state_hash", ctypes.c_uint64),
                ("publish_ns", ctypes.c_uint64), ("count", ctypes.c_uint32),
                ("substeps", ctypes.c_uint32), ("flags", ctypes.c_uint32),
                ("reserved", ctypes.c_uint32 * 5)]

    @staticmethod
    def type_name() -> str:
        return "cosplat.v1.FrameHeader"


session = sys.argv[1] if len(sys.argv) > 1 else "default"
domain, user = os.environ.get("COSPLAT_DOMAIN", ""), os.getuid()
root = domain if domain.startswith("/") else f"/tmp/cosplat-{user}" + (f"-{domain}" if domain else "")
config = iox2.config.default()
config.global_cfg.root_path = iox2.Path.new(root)
config.global_cfg.prefix = iox2.FileName.new(os.path.basename(root) + "_")
node = (iox2.NodeBuilder.new().name(iox2.NodeName.new("cosplat-python")).config(config)
        .signal_handling_mode(iox2.SignalHandlingMode.Disabled).create(iox2.ServiceType.Ipc))
name = iox2.ServiceName.new(f"cosplat/{session}/v1/frame")
frames = (node.service_builder(name).publish_subscribe(iox2.Slice[GaussianState])
          .user_header(FrameHeader).open().subscriber_builder().buffer_size(1).create())
wake = node.service_builder(name).event().open().listener_builder().create()

while True:
    wake.timed_wait(iox2.Duration.from_millis(20))
    sample = frames.receive()
    if sample is None:
        continue
    header = sample.user_header().contents
    count = sample.header.number_of_elements      # len(payload()) counts bytes
    assert header.count == count
    memory = (ctypes.c_char * (64 * count)).from_address(sample.payload_ptr)
    values = np.frombuffer(memory, dtype=np.float32).reshape(count, 16)
    values.flags.writeable = False                # the pages are read-only: a write would kill us
    print(f"step {header.step} at {header.sim_time:.3f} s: {count} Gaussians, "
          f"the highest at {values[:, 2].max()} m", flush=True)
    last = header.flags & 4
    del values, memory, header, sample            # the next receive may reuse the memory
    if last:
        break

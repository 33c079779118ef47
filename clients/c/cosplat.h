/* Wire types of cosplat for C11 and C++11; docs/wire-format.md says what they mean.
 *
 * Written from the Rust types by `COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib bindings`; a test keeps it equal
 * to them. SPDX-License-Identifier: MIT OR Apache-2.0 */

#ifndef COSPLAT_H
#define COSPLAT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define COSPLAT_ASSERT static_assert
#define COSPLAT_ALIGNOF alignof
#define COSPLAT_ALIGNAS alignas
#else
#define COSPLAT_ASSERT _Static_assert
#define COSPLAT_ALIGNOF _Alignof
#define COSPLAT_ALIGNAS _Alignas
#endif

/** Hash of the layout of all types: a server with another one in its hello must not be read. */
#define COSPLAT_SCHEMA_HASH UINT64_C(0x9d9272eb044a0f5b)
/** All of the object is as its own frame had it last, at another place. */
#define COSPLAT_CHANGE_PLACED UINT32_C(1)
/** The object's Gaussians follow, in the world frame. */
#define COSPLAT_CHANGE_GAUSSIANS UINT32_C(2)
/** The object's Gaussians follow, in its own frame, and its place: what `CHANGE_PLACED` refers to from now on. */
#define COSPLAT_CHANGE_FORM UINT32_C(3)
/** `Command::kind`: add `vector` [N s] to the momentum of `object`. */
#define COSPLAT_COMMAND_IMPULSE UINT32_C(1)
/** Impulse `vector` [N s] on the particles of `object` within `radius` of `point`. */
#define COSPLAT_COMMAND_IMPULSE_AT UINT32_C(2)
/** Give `object` the velocity `vector` [m/s] and the spin `point` [rad/s]. */
#define COSPLAT_COMMAND_SET_VELOCITY UINT32_C(3)
/** Give `object`, or one region of it, the material `material`; mass stays. With a `radius` only what is within it of `point`, with `vector` only what is in the box about `point` with these half edges [m]. */
#define COSPLAT_COMMAND_SET_MATERIAL UINT32_C(4)
/** Set gravity to `vector` [m/s^2]. */
#define COSPLAT_COMMAND_SET_GRAVITY UINT32_C(5)
/** Stop stepping before the next step. */
#define COSPLAT_COMMAND_PAUSE UINT32_C(6)
/** Step again. */
#define COSPLAT_COMMAND_RESUME UINT32_C(7)
/** Back to the initial state. */
#define COSPLAT_COMMAND_RESET UINT32_C(8)
/** Shut the server down cleanly. */
#define COSPLAT_COMMAND_STOP UINT32_C(9)
/** Move collider number `object` so that at the end of the frame its origin is at `vector` [m], turned by the rotation vector `point` [rad]. */
#define COSPLAT_COMMAND_MOVE_COLLIDER UINT32_C(10)
/** Hold the particles of `object` that are within `radius` of `point` now; all of them when `radius` is 0. */
#define COSPLAT_COMMAND_PIN UINT32_C(11)
/** Let go what `COMMAND_PIN` holds of `object`. */
#define COSPLAT_COMMAND_RELEASE UINT32_C(12)
/** Write a checkpoint of the state before `apply_at_step`; the answer's `reason` is the file's path. */
#define COSPLAT_COMMAND_CHECKPOINT UINT32_C(13)
/** Force `vector` [N] and torque `point` [N m] about the centre of mass on `object` during the step. */
#define COSPLAT_COMMAND_FORCE UINT32_C(14)
/** Force `vector` [N] during the step on the particles of `object` within `radius` of `point`. */
#define COSPLAT_COMMAND_FORCE_AT UINT32_C(15)
/** Move collider number `object` with velocity `vector` [m/s] and spin `point` [rad/s] during the step; then it stands. */
#define COSPLAT_COMMAND_COLLIDER_VELOCITY UINT32_C(16)
/** Keep the state in the server's memory as snapshot number `object`, in place of a former one of that number. */
#define COSPLAT_COMMAND_SAVE UINT32_C(17)
/** Back to the state of snapshot number `object`; the step count goes on. */
#define COSPLAT_COMMAND_RESTORE UINT32_C(18)
/** Make `object` steps while the server is paused, 1 to 1,000,000; answered when the last frame was sent. */
#define COSPLAT_COMMAND_STEP UINT32_C(19)
/** Have a replay go to `apply_at_step`, or to the first recorded step behind it; servers that simulate refuse it. */
#define COSPLAT_COMMAND_SEEK UINT32_C(20)
/** Hold the particles of `object` that are within `radius` of `point` by a spring that pulls the point to `vector` [m], for `material.region` steps without `COMMAND_DRAG`, 0 for 60. */
#define COSPLAT_COMMAND_GRAB UINT32_C(21)
/** Pull what the sender holds of `object` to `vector` [m], where the spring's end is when the step ends. */
#define COSPLAT_COMMAND_DRAG UINT32_C(22)
/** Let go what the sender holds of `object`. */
#define COSPLAT_COMMAND_LET_GO UINT32_C(23)
/** Put `object` at rest with its centre of mass at `vector` [m], turned since rest by the rotation vector `point` [rad]; `material.region` is 0 or `POSE_*` flags. */
#define COSPLAT_COMMAND_SET_POSE UINT32_C(24)
/** Model `object` as `material.region` says: 1 as one body that stands, 2 as matter, 3 with as little as allowed, 4 as one body. */
#define COSPLAT_COMMAND_SET_FIDELITY UINT32_C(25)
/** Take `object` out of the world; it keeps its number. */
#define COSPLAT_COMMAND_REMOVE UINT32_C(26)
/** Bring `object` in that was removed or is absent from the beginning, at a pose as of `COMMAND_SET_POSE`. */
#define COSPLAT_COMMAND_BRING_IN UINT32_C(27)
/** Back to the state right before the newest edit; the step count goes on. */
#define COSPLAT_COMMAND_UNDO UINT32_C(28)
/** Back to the state that the newest `COMMAND_UNDO` left; the step count goes on. */
#define COSPLAT_COMMAND_REDO UINT32_C(29)
/** Drop the orders that wait for their step, at once: `object` 0 those of the sender's `client` number, 1 those of all. */
#define COSPLAT_COMMAND_CANCEL UINT32_C(30)
/** Flag of a pose: the object keeps its place, and `vector` is not read. */
#define COSPLAT_POSE_KEEP_PLACE UINT32_C(1)
/** Flag of a pose: the object keeps its rotation, and `point` is not read. */
#define COSPLAT_POSE_KEEP_ROTATION UINT32_C(2)
/** The command takes effect at `applied_at_step`. */
#define COSPLAT_ACK_ACCEPTED UINT32_C(1)
/** The command is refused and changes nothing; see `reason`. */
#define COSPLAT_ACK_REFUSED UINT32_C(2)
/** Commands that one request and one journal message hold at most. */
#define COSPLAT_MAX_COMMANDS ((size_t)32)
/** `other` is an object. */
#define COSPLAT_CONTACT_OBJECT UINT32_C(1)
/** `other` is a collider. */
#define COSPLAT_CONTACT_COLLIDER UINT32_C(2)
/** The state was set back to the initial one in this step. */
#define COSPLAT_FRAME_FLAG_RESET UINT32_C(1)
/** The server was paused when it sent this frame: no step follows before it is resumed. A pause that comes later is told by `status` alone. */
#define COSPLAT_FRAME_FLAG_PAUSED UINT32_C(2)
/** This is the last frame of the session. */
#define COSPLAT_FRAME_FLAG_LAST UINT32_C(4)
/** The state was set back to that of a snapshot in this step. */
#define COSPLAT_FRAME_FLAG_RESTORED UINT32_C(8)
/** Major version of the wire contract; part of every service and type name. */
#define COSPLAT_WIRE_VERSION UINT32_C(1)
/** `SceneFile::kind`: a splat or mesh that the scene file names. */
#define COSPLAT_SCENE_FILE_ASSET UINT32_C(1)
/** `SceneFile::kind`: the checkpoint that the server began with. */
#define COSPLAT_SCENE_FILE_CHECKPOINT UINT32_C(2)
/** The server is stepping. */
#define COSPLAT_SERVER_RUNNING UINT32_C(1)
/** The server is paused. */
#define COSPLAT_SERVER_PAUSED UINT32_C(2)
/** The server is shutting down. */
#define COSPLAT_SERVER_STOPPING UINT32_C(3)
/** The server waits for participants in lock-step. */
#define COSPLAT_SERVER_WAITING UINT32_C(4)
/** The sender takes part from now on, and every step waits for it. Without commands. */
#define COSPLAT_STEP_ATTACH UINT32_C(1)
/** The sender permits `frames` steps; the answer comes after the last frame was sent. */
#define COSPLAT_STEP_ADVANCE UINT32_C(2)
/** The sender takes part no more. Without commands. */
#define COSPLAT_STEP_DETACH UINT32_C(3)
/** Answer at the end of a step in which `pair` touches. */
#define COSPLAT_UNTIL_CONTACT UINT32_C(1)
/** Answer at the end of a step with an event: particles left the domain, an object fell apart, the state was set back. */
#define COSPLAT_UNTIL_EVENT UINT32_C(2)
/** Answer at the end of a step in which particles were frozen because their state stayed bad. */
#define COSPLAT_UNTIL_QUARANTINE UINT32_C(4)
/** Any object or collider. */
#define COSPLAT_ANY UINT32_C(4294967295)
/** Most steps in a request. */
#define COSPLAT_MAX_STEPS UINT32_C(1000000)
/** All was done as asked. */
#define COSPLAT_RETURN_COMPLETE UINT32_C(1)
/** The pair touches. */
#define COSPLAT_RETURN_CONTACT UINT32_C(2)
/** An event; `reason` says which. */
#define COSPLAT_RETURN_EVENT UINT32_C(3)
/** Particles were frozen. */
#define COSPLAT_RETURN_QUARANTINE UINT32_C(4)
/** The server ends, and no step follows. */
#define COSPLAT_RETURN_TERMINATE UINT32_C(5)
/** `timeout_ns` is over; `reason` names who was waited for. */
#define COSPLAT_RETURN_TIMEOUT UINT32_C(6)
/** The request is refused, all of its commands with it; `reason` says why. */
#define COSPLAT_RETURN_REFUSED UINT32_C(7)

/** Who serves the session. Service and type name carry no version, and this layout never changes. */
struct cosplat_hello {
    /** The server's `WIRE_VERSION`. */
    uint32_t wire_version;
    /** The server's process id. */
    uint32_t pid;
    /** Hash of the server's layout table. */
    uint64_t schema_hash;
    /** Grows with every start of a server. */
    uint64_t epoch;
    /** Release of the server, UTF-8, zero-padded. */
    char server_version[24];
    /** First step of the recording that the server replays; 0 where it simulates. */
    uint64_t recorded_first;
    /** Last step of that recording; 0 where it simulates. */
    uint64_t recorded_last;
};
#define COSPLAT_HELLO_TYPE_NAME "cosplat.Hello"
COSPLAT_ASSERT(sizeof(struct cosplat_hello) == 64, "cosplat_hello");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_hello) == 8, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, wire_version) == 0, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, pid) == 4, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, schema_hash) == 8, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, epoch) == 16, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, server_version) == 24, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, recorded_first) == 48, "cosplat_hello");
COSPLAT_ASSERT(offsetof(struct cosplat_hello, recorded_last) == 56, "cosplat_hello");

/** One Gaussian: one cache line. */
struct cosplat_gaussian_state {
    /** Centre [m], world frame. */
    COSPLAT_ALIGNAS(64) float position[3];
    /** Base colour and opacity, RGBA, 0..=255, not premultiplied. */
    uint8_t color[4];
    /** Covariance xx xy xz yy yz zz [m^2], world frame. */
    float covariance[6];
    /** Object id. */
    uint32_t object;
    /** Index of this Gaussian in the `scene` blocks. */
    uint32_t index;
    /** World-from-asset rotation (polar part of F times the placement), unit quaternion xyzw: evaluate the spherical harmonics of the `scene` blocks in the view direction turned back by it. */
    float rotation[4];
};
#define COSPLAT_GAUSSIAN_STATE_TYPE_NAME "cosplat.v1.GaussianState"
COSPLAT_ASSERT(sizeof(struct cosplat_gaussian_state) == 64, "cosplat_gaussian_state");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_gaussian_state) == 64, "cosplat_gaussian_state");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_state, position) == 0, "cosplat_gaussian_state");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_state, color) == 12, "cosplat_gaussian_state");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_state, covariance) == 16, "cosplat_gaussian_state");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_state, object) == 40, "cosplat_gaussian_state");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_state, index) == 44, "cosplat_gaussian_state");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_state, rotation) == 48, "cosplat_gaussian_state");

/** User header of `frame`. */
struct cosplat_frame_header {
    /** Step count; consecutive frames differ by 1, anything else is a gap. */
    uint64_t step;
    /** Simulated time at the end of the step [s]. */
    double sim_time;
    /** Size of the last substep [s]. */
    double dt;
    /** Identifies the published scene; a client that sees a new epoch re-reads it. */
    uint64_t epoch;
    /** Hash of the complete simulation state. */
    uint64_t state_hash;
    /** `CLOCK_MONOTONIC` when the frame was sent [ns]. */
    uint64_t publish_ns;
    /** Gaussians in this frame. */
    uint32_t count;
    /** Substeps in this step. */
    uint32_t substeps;
    /** `FRAME_FLAG_*`. */
    uint32_t flags;
    /** Zero. */
    uint32_t reserved[5];
};
#define COSPLAT_FRAME_HEADER_TYPE_NAME "cosplat.v1.FrameHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_frame_header) == 80, "cosplat_frame_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_frame_header) == 8, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, step) == 0, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, sim_time) == 8, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, dt) == 16, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, epoch) == 24, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, state_hash) == 32, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, publish_ns) == 40, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, count) == 48, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, substeps) == 52, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, flags) == 56, "cosplat_frame_header");
COSPLAT_ASSERT(offsetof(struct cosplat_frame_header, reserved) == 60, "cosplat_frame_header");

/** 64 bytes of a `changes` message: rows first, then Gaussians. */
struct cosplat_change_slot {
    /** As many whole slots as the `ObjectChange` rows take, one after the other; then one `GaussianState` each. */
    COSPLAT_ALIGNAS(64) uint64_t words[8];
};
#define COSPLAT_CHANGE_SLOT_TYPE_NAME "cosplat.v1.ChangeSlot"
COSPLAT_ASSERT(sizeof(struct cosplat_change_slot) == 64, "cosplat_change_slot");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_change_slot) == 64, "cosplat_change_slot");
COSPLAT_ASSERT(offsetof(struct cosplat_change_slot, words) == 0, "cosplat_change_slot");

/** How one object has changed. */
struct cosplat_object_change {
    /** Object id. */
    uint32_t object;
    /** `CHANGE_*`. */
    uint32_t kind;
    /** Its first Gaussian in the frame. */
    uint32_t first;
    /** Its Gaussians. */
    uint32_t count;
    /** The slot of its first Gaussian in this message; 0 for `CHANGE_PLACED`. */
    uint32_t slot;
    /** Zero. */
    uint32_t reserved;
    /** Where its own frame has its origin [m]; zeros for `CHANGE_GAUSSIANS`. */
    double position[3];
    /** World-from-own rotation, unit quaternion xyzw; zeros for `CHANGE_GAUSSIANS`. */
    double rotation[4];
};
#define COSPLAT_OBJECT_CHANGE_TYPE_NAME "cosplat.v1.ObjectChange"
COSPLAT_ASSERT(sizeof(struct cosplat_object_change) == 80, "cosplat_object_change");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_object_change) == 8, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, object) == 0, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, kind) == 4, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, first) == 8, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, count) == 12, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, slot) == 16, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, reserved) == 20, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, position) == 24, "cosplat_object_change");
COSPLAT_ASSERT(offsetof(struct cosplat_object_change, rotation) == 48, "cosplat_object_change");

/** User header of `changes`. */
struct cosplat_changes_header {
    /** Step count, as in `frame`. */
    uint64_t step;
    /** Simulated time at the end of the step [s]. */
    double sim_time;
    /** Size of the last substep [s]. */
    double dt;
    /** As in `frame`. */
    uint64_t epoch;
    /** Hash of the complete simulation state, as in `frame`. */
    uint64_t state_hash;
    /** `CLOCK_MONOTONIC` when the message was sent [ns]. */
    uint64_t publish_ns;
    /** The step of the message that this one builds on; its own step where it is complete by itself. */
    uint64_t since;
    /** Slots in this message. */
    uint32_t count;
    /** `ObjectChange` rows in it. */
    uint32_t objects;
    /** Gaussians of the whole frame. */
    uint32_t gaussians;
    /** Substeps in this step. */
    uint32_t substeps;
    /** `FRAME_FLAG_*`. */
    uint32_t flags;
    /** Zero. */
    uint32_t reserved;
};
#define COSPLAT_CHANGES_HEADER_TYPE_NAME "cosplat.v1.ChangesHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_changes_header) == 80, "cosplat_changes_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_changes_header) == 8, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, step) == 0, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, sim_time) == 8, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, dt) == 16, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, epoch) == 24, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, state_hash) == 32, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, publish_ns) == 40, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, since) == 48, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, count) == 56, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, objects) == 60, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, gaussians) == 64, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, substeps) == 68, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, flags) == 72, "cosplat_changes_header");
COSPLAT_ASSERT(offsetof(struct cosplat_changes_header, reserved) == 76, "cosplat_changes_header");

/** One object. */
struct cosplat_object_state {
    /** Object id. */
    uint32_t id;
    /** How it is modelled at present: 1 static, 2 MPM, 3 asleep, 4 rigid, 6 nothing is left of it, 7 removed. */
    uint32_t fidelity;
    /** Mass [kg]. */
    double mass;
    /** Centre of mass [m]. */
    double com[3];
    /** Rotation since rest, unit quaternion xyzw. */
    double rotation[4];
    /** Velocity of the centre of mass [m/s]. */
    double linear_velocity[3];
    /** Angular velocity [rad/s]. */
    double angular_velocity[3];
    /** Inertia about the centre of mass xx xy xz yy yz zz [kg m^2]. */
    double inertia[6];
    /** Effective radius [m]. */
    double radius;
    /** Kinetic energy [J]. */
    double kinetic_energy;
    /** Elastic energy [J]. */
    double elastic_energy;
    /** Impulse from colliders and other objects during the step [N s]. */
    double contact_impulse[3];
};
#define COSPLAT_OBJECT_STATE_TYPE_NAME "cosplat.v1.ObjectState"
COSPLAT_ASSERT(sizeof(struct cosplat_object_state) == 216, "cosplat_object_state");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_object_state) == 8, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, id) == 0, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, fidelity) == 4, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, mass) == 8, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, com) == 16, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, rotation) == 40, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, linear_velocity) == 72, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, angular_velocity) == 96, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, inertia) == 120, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, radius) == 168, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, kinetic_energy) == 176, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, elastic_energy) == 184, "cosplat_object_state");
COSPLAT_ASSERT(offsetof(struct cosplat_object_state, contact_impulse) == 192, "cosplat_object_state");

/** User header of `objects`. */
struct cosplat_objects_header {
    /** Step count, as in `frame`. */
    uint64_t step;
    /** Simulated time [s]. */
    double sim_time;
    /** As in `frame`. */
    uint64_t epoch;
    /** Objects in this message. */
    uint32_t count;
    /** Zero. */
    uint32_t reserved;
    /** Hash of the complete simulation state, as in `frame`; here also of steps whose frame was skipped. */
    uint64_t state_hash;
};
#define COSPLAT_OBJECTS_HEADER_TYPE_NAME "cosplat.v1.ObjectsHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_objects_header) == 40, "cosplat_objects_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_objects_header) == 8, "cosplat_objects_header");
COSPLAT_ASSERT(offsetof(struct cosplat_objects_header, step) == 0, "cosplat_objects_header");
COSPLAT_ASSERT(offsetof(struct cosplat_objects_header, sim_time) == 8, "cosplat_objects_header");
COSPLAT_ASSERT(offsetof(struct cosplat_objects_header, epoch) == 16, "cosplat_objects_header");
COSPLAT_ASSERT(offsetof(struct cosplat_objects_header, count) == 24, "cosplat_objects_header");
COSPLAT_ASSERT(offsetof(struct cosplat_objects_header, reserved) == 28, "cosplat_objects_header");
COSPLAT_ASSERT(offsetof(struct cosplat_objects_header, state_hash) == 32, "cosplat_objects_header");

/** A pair that touched during a step. */
struct cosplat_contact {
    /** Object id; of two objects the lower one. */
    uint32_t object;
    /** Object id or number of a collider. */
    uint32_t other;
    /** What `other` is, `CONTACT_*`. */
    uint32_t kind;
    /** Zero. */
    uint32_t reserved;
    /** Where they touch [m], world frame: mean weighted by normal impulses. */
    double point[3];
    /** Unit normal that points from `other` to `object`. */
    double normal[3];
    /** Impulse that `object` received from `other` during the step [N s]. */
    double impulse[3];
};
#define COSPLAT_CONTACT_TYPE_NAME "cosplat.v1.Contact"
COSPLAT_ASSERT(sizeof(struct cosplat_contact) == 88, "cosplat_contact");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_contact) == 8, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, object) == 0, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, other) == 4, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, kind) == 8, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, reserved) == 12, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, point) == 16, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, normal) == 40, "cosplat_contact");
COSPLAT_ASSERT(offsetof(struct cosplat_contact, impulse) == 64, "cosplat_contact");

/** User header of `contacts`. */
struct cosplat_contacts_header {
    /** Step count, as in `frame`. */
    uint64_t step;
    /** Simulated time [s]. */
    double sim_time;
    /** As in `frame`. */
    uint64_t epoch;
    /** Contacts in this message. */
    uint32_t count;
    /** Contacts in the step; more than `count` when the message holds only the strongest. */
    uint32_t total;
};
#define COSPLAT_CONTACTS_HEADER_TYPE_NAME "cosplat.v1.ContactsHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_contacts_header) == 32, "cosplat_contacts_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_contacts_header) == 8, "cosplat_contacts_header");
COSPLAT_ASSERT(offsetof(struct cosplat_contacts_header, step) == 0, "cosplat_contacts_header");
COSPLAT_ASSERT(offsetof(struct cosplat_contacts_header, sim_time) == 8, "cosplat_contacts_header");
COSPLAT_ASSERT(offsetof(struct cosplat_contacts_header, epoch) == 16, "cosplat_contacts_header");
COSPLAT_ASSERT(offsetof(struct cosplat_contacts_header, count) == 24, "cosplat_contacts_header");
COSPLAT_ASSERT(offsetof(struct cosplat_contacts_header, total) == 28, "cosplat_contacts_header");

/** One Gaussian at rest (block `scene/gaussians`). */
struct cosplat_gaussian_rest {
    /** Centre [m]. */
    float position[3];
    /** Opacity, 0..=1. */
    float opacity;
    /** Standard deviations along the local axes [m]. */
    float scale[3];
    /** Object id. */
    uint32_t object;
    /** World-from-local rotation, unit quaternion xyzw. */
    float rotation[4];
};
#define COSPLAT_GAUSSIAN_REST_TYPE_NAME "cosplat.v1.GaussianRest"
COSPLAT_ASSERT(sizeof(struct cosplat_gaussian_rest) == 48, "cosplat_gaussian_rest");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_gaussian_rest) == 4, "cosplat_gaussian_rest");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_rest, position) == 0, "cosplat_gaussian_rest");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_rest, opacity) == 12, "cosplat_gaussian_rest");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_rest, scale) == 16, "cosplat_gaussian_rest");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_rest, object) == 28, "cosplat_gaussian_rest");
COSPLAT_ASSERT(offsetof(struct cosplat_gaussian_rest, rotation) == 32, "cosplat_gaussian_rest");

/** One object (block `scene/objects`). */
struct cosplat_object_info {
    /** Object id. */
    uint32_t id;
    /** How the scene asks for it: 1 static, 2 MPM, 3 automatic, 4 rigid. */
    uint32_t fidelity;
    /** Particles of the object. */
    uint32_t particle_count;
    /** Index of its first Gaussian. */
    uint32_t gaussian_first;
    /** Gaussians of the object. */
    uint32_t gaussian_count;
    /** Constitutive law, as in `MaterialSpec`. */
    uint32_t law;
    /** Young's modulus [Pa]. */
    double youngs_modulus;
    /** Poisson's ratio. */
    double poisson_ratio;
    /** Density [kg/m^3]. */
    double density;
    /** Name, UTF-8, zero-padded. */
    char name[64];
    /** Material name, UTF-8, zero-padded. */
    char material[32];
};
#define COSPLAT_OBJECT_INFO_TYPE_NAME "cosplat.v1.ObjectInfo"
COSPLAT_ASSERT(sizeof(struct cosplat_object_info) == 144, "cosplat_object_info");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_object_info) == 8, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, id) == 0, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, fidelity) == 4, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, particle_count) == 8, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, gaussian_first) == 12, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, gaussian_count) == 16, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, law) == 20, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, youngs_modulus) == 24, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, poisson_ratio) == 32, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, density) == 40, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, name) == 48, "cosplat_object_info");
COSPLAT_ASSERT(offsetof(struct cosplat_object_info, material) == 112, "cosplat_object_info");

/** One file that the server read beside the scene file (block `scene/files`). With them the run can be simulated again. */
struct cosplat_scene_file {
    /** `SCENE_FILE_*`. */
    uint32_t kind;
    /** Zero. */
    uint32_t reserved;
    /** Length of its content when the server read it [byte]. */
    uint64_t length;
    /** XXH3 of its content then, 64 bits, seed 0. */
    uint64_t hash;
    /** As the scene file names it; the file name of a checkpoint. UTF-8, zero-padded. */
    char name[4096];
    /** Absolute path on the server's machine, UTF-8, zero-padded. */
    char path[4096];
};
#define COSPLAT_SCENE_FILE_TYPE_NAME "cosplat.v1.SceneFile"
COSPLAT_ASSERT(sizeof(struct cosplat_scene_file) == 8216, "cosplat_scene_file");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_scene_file) == 8, "cosplat_scene_file");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_file, kind) == 0, "cosplat_scene_file");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_file, reserved) == 4, "cosplat_scene_file");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_file, length) == 8, "cosplat_scene_file");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_file, hash) == 16, "cosplat_scene_file");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_file, name) == 24, "cosplat_scene_file");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_file, path) == 4120, "cosplat_scene_file");

/** User header of every `scene` block. */
struct cosplat_scene_header {
    /** Identifies this publication of the scene. */
    uint64_t epoch;
    /** Hash of the scene; equal for equal scenes, also after a restart. */
    uint64_t scene_hash;
    /** Published frames per simulated second [1/s]. */
    double frame_rate;
    /** Grid cell size [m]. */
    double dx;
    /** Initial gravity [m/s^2]. */
    double gravity[3];
    /** Box to look at [m]: what moves, at rest, without outliers, down to a floor nearby; smallest corner. */
    float bounds_min[3];
    /** Largest corner [m]. */
    float bounds_max[3];
    /** Gaussians in the scene. */
    uint32_t gaussian_count;
    /** Particles in the scene. */
    uint32_t particle_count;
    /** Objects in the scene. */
    uint32_t object_count;
    /** Spherical-harmonics degree, 0..=3 (block `scene/sh`: `[gaussian][coefficient][rgb]` f32). */
    uint32_t sh_degree;
    /** Semantic feature length, 0 = none (block `scene/features`: `[gaussian][feature_dim]` f32). */
    uint32_t feature_dim;
    /** Zero. */
    uint32_t reserved;
};
#define COSPLAT_SCENE_HEADER_TYPE_NAME "cosplat.v1.SceneHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_scene_header) == 104, "cosplat_scene_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_scene_header) == 8, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, epoch) == 0, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, scene_hash) == 8, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, frame_rate) == 16, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, dx) == 24, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, gravity) == 32, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, bounds_min) == 56, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, bounds_max) == 68, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, gaussian_count) == 80, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, particle_count) == 84, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, object_count) == 88, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, sh_degree) == 92, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, feature_dim) == 96, "cosplat_scene_header");
COSPLAT_ASSERT(offsetof(struct cosplat_scene_header, reserved) == 100, "cosplat_scene_header");

/** Law and parameters of a material; `docs/wire-format.md` lists the laws. */
struct cosplat_material_spec {
    /** Constitutive law, 1 to 10. */
    uint32_t law;
    /** 0 for the whole object, `n` for its region `n`, counted from 1. Of `COMMAND_GRAB` a number of steps, of `COMMAND_SET_POSE` and `COMMAND_BRING_IN` flags, of `COMMAND_SET_FIDELITY` a level. */
    uint32_t region;
    /** Young's modulus [Pa]; not read for fluid and rigid matter. */
    double youngs_modulus;
    /** Poisson's ratio; not read for fluid and rigid matter. */
    double poisson_ratio;
    /** What else the law needs, in the order of `docs/wire-format.md`; the rest zero. */
    double parameters[4];
};
#define COSPLAT_MATERIAL_SPEC_TYPE_NAME "cosplat.v1.MaterialSpec"
COSPLAT_ASSERT(sizeof(struct cosplat_material_spec) == 56, "cosplat_material_spec");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_material_spec) == 8, "cosplat_material_spec");
COSPLAT_ASSERT(offsetof(struct cosplat_material_spec, law) == 0, "cosplat_material_spec");
COSPLAT_ASSERT(offsetof(struct cosplat_material_spec, region) == 4, "cosplat_material_spec");
COSPLAT_ASSERT(offsetof(struct cosplat_material_spec, youngs_modulus) == 8, "cosplat_material_spec");
COSPLAT_ASSERT(offsetof(struct cosplat_material_spec, poisson_ratio) == 16, "cosplat_material_spec");
COSPLAT_ASSERT(offsetof(struct cosplat_material_spec, parameters) == 24, "cosplat_material_spec");

/** One order. Fields that a kind does not name are zero. */
struct cosplat_command {
    /** `COMMAND_*`. */
    uint32_t kind;
    /** Object id, or another number; see the kinds. */
    uint32_t object;
    /** The sender's running number. */
    uint64_t sequence;
    /** Step at whose start it takes effect; 0 or a past step means the next one. */
    uint64_t apply_at_step;
    /** Main vector; see the kinds. */
    double vector[3];
    /** Point [m], or the second vector; see the kinds. */
    double point[3];
    /** Radius [m]. */
    double radius;
    /** For `COMMAND_SET_MATERIAL`; of other kinds `region` alone, where they say so. */
    struct cosplat_material_spec material;
};
#define COSPLAT_COMMAND_TYPE_NAME "cosplat.v1.Command"
COSPLAT_ASSERT(sizeof(struct cosplat_command) == 136, "cosplat_command");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_command) == 8, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, kind) == 0, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, object) == 4, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, sequence) == 8, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, apply_at_step) == 16, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, vector) == 24, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, point) == 48, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, radius) == 72, "cosplat_command");
COSPLAT_ASSERT(offsetof(struct cosplat_command, material) == 80, "cosplat_command");

/** User header of a request with commands. */
struct cosplat_command_header {
    /** Random number that identifies the sender for the life of its process. */
    uint64_t client;
    /** Sender's process id. */
    uint32_t pid;
    /** Commands in the request. */
    uint32_t count;
};
#define COSPLAT_COMMAND_HEADER_TYPE_NAME "cosplat.v1.CommandHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_command_header) == 16, "cosplat_command_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_command_header) == 8, "cosplat_command_header");
COSPLAT_ASSERT(offsetof(struct cosplat_command_header, client) == 0, "cosplat_command_header");
COSPLAT_ASSERT(offsetof(struct cosplat_command_header, pid) == 8, "cosplat_command_header");
COSPLAT_ASSERT(offsetof(struct cosplat_command_header, count) == 12, "cosplat_command_header");

/** Answer to one command; a response holds one per command of the request, in the same order. */
struct cosplat_ack {
    /** Sequence of the command answered. */
    uint64_t sequence;
    /** Step at whose start it takes effect. */
    uint64_t applied_at_step;
    /** `ACK_*`. */
    uint32_t status;
    /** Zero. */
    uint32_t reserved;
    /** For refusals a sentence with expected and actual values, for checkpoints the path; UTF-8, zero-padded. */
    char reason[168];
};
#define COSPLAT_ACK_TYPE_NAME "cosplat.v1.Ack"
COSPLAT_ASSERT(sizeof(struct cosplat_ack) == 192, "cosplat_ack");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_ack) == 8, "cosplat_ack");
COSPLAT_ASSERT(offsetof(struct cosplat_ack, sequence) == 0, "cosplat_ack");
COSPLAT_ASSERT(offsetof(struct cosplat_ack, applied_at_step) == 8, "cosplat_ack");
COSPLAT_ASSERT(offsetof(struct cosplat_ack, status) == 16, "cosplat_ack");
COSPLAT_ASSERT(offsetof(struct cosplat_ack, reserved) == 20, "cosplat_ack");
COSPLAT_ASSERT(offsetof(struct cosplat_ack, reason) == 24, "cosplat_ack");

/** User header of a request on `step`; the payload is the commands that go with it. */
struct cosplat_step_request {
    /** Number that orders the commands of a step and stands in the journal; see `docs/wire-format.md`. */
    uint64_t client;
    /** Sender's process id. */
    uint32_t pid;
    /** Commands in the request. */
    uint32_t count;
    /** `STEP_*`. */
    uint32_t kind;
    /** Steps asked for, 1 to 1,000,000; 0 for `STEP_ATTACH` and `STEP_DETACH`. */
    uint32_t frames;
    /** Sum of `UNTIL_*`: what brings the answer before the last of these steps. */
    uint32_t until;
    /** For `UNTIL_CONTACT`: what `pair[1]` is, `CONTACT_*`; 0 for either. */
    uint32_t pair_kind;
    /** For `UNTIL_CONTACT`: object and other; `ANY` for whichever. */
    uint32_t pair[2];
    /** Wall time after which the answer comes with the steps made until then [ns]; 0 for no limit. */
    uint64_t timeout_ns;
    /** Name, 1 to 48 of the characters a-z A-Z 0-9 - _ . , zero-padded. */
    char participant[48];
};
#define COSPLAT_STEP_REQUEST_TYPE_NAME "cosplat.v1.StepRequest"
COSPLAT_ASSERT(sizeof(struct cosplat_step_request) == 96, "cosplat_step_request");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_step_request) == 8, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, client) == 0, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, pid) == 8, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, count) == 12, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, kind) == 16, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, frames) == 20, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, until) == 24, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, pair_kind) == 28, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, pair) == 32, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, timeout_ns) == 40, "cosplat_step_request");
COSPLAT_ASSERT(offsetof(struct cosplat_step_request, participant) == 48, "cosplat_step_request");

/** User header of an answer on `step`; the payload is one `Ack` per command, in the same order. */
struct cosplat_step_done {
    /** Steps completed by the server; the frame of this step was sent. */
    uint64_t step;
    /** Simulated time at the end of it [s]. */
    double sim_time;
    /** As in `frame`. */
    uint64_t epoch;
    /** Hash of the state after it, as in `frame`. */
    uint64_t state_hash;
    /** Wall time that the server spent on the steps of this request, publishing included [ns]. */
    uint64_t step_ns;
    /** Steps made for this request. */
    uint32_t frames;
    /** `RETURN_*`. */
    uint32_t cause;
    /** Answers in the payload. */
    uint32_t count;
    /** For `RETURN_CONTACT`: what `contact[1]` is, `CONTACT_*`. */
    uint32_t contact_kind;
    /** For `RETURN_CONTACT`: object and other. */
    uint32_t contact[2];
    /** For all causes but `RETURN_COMPLETE` a sentence; UTF-8, zero-padded. */
    char reason[128];
};
#define COSPLAT_STEP_DONE_TYPE_NAME "cosplat.v1.StepDone"
COSPLAT_ASSERT(sizeof(struct cosplat_step_done) == 192, "cosplat_step_done");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_step_done) == 8, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, step) == 0, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, sim_time) == 8, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, epoch) == 16, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, state_hash) == 24, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, step_ns) == 32, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, frames) == 40, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, cause) == 44, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, count) == 48, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, contact_kind) == 52, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, contact) == 56, "cosplat_step_done");
COSPLAT_ASSERT(offsetof(struct cosplat_step_done, reason) == 64, "cosplat_step_done");

/** One entry of `journal`: a command as it was applied. */
struct cosplat_applied_command {
    /** Step at whose start it took effect. */
    uint64_t step;
    /** Who sent it. */
    uint64_t client;
    /** The command. */
    struct cosplat_command command;
};
#define COSPLAT_APPLIED_COMMAND_TYPE_NAME "cosplat.v1.AppliedCommand"
COSPLAT_ASSERT(sizeof(struct cosplat_applied_command) == 152, "cosplat_applied_command");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_applied_command) == 8, "cosplat_applied_command");
COSPLAT_ASSERT(offsetof(struct cosplat_applied_command, step) == 0, "cosplat_applied_command");
COSPLAT_ASSERT(offsetof(struct cosplat_applied_command, client) == 8, "cosplat_applied_command");
COSPLAT_ASSERT(offsetof(struct cosplat_applied_command, command) == 16, "cosplat_applied_command");

/** User header of `journal`. */
struct cosplat_journal_header {
    /** Step at whose start the commands took effect. */
    uint64_t step;
    /** As in `frame`. */
    uint64_t epoch;
    /** Commands journalled in this epoch before this message; a jump shows that messages were lost. */
    uint64_t first;
    /** Commands in this message. */
    uint32_t count;
    /** Zero. */
    uint32_t reserved;
};
#define COSPLAT_JOURNAL_HEADER_TYPE_NAME "cosplat.v1.JournalHeader"
COSPLAT_ASSERT(sizeof(struct cosplat_journal_header) == 32, "cosplat_journal_header");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_journal_header) == 8, "cosplat_journal_header");
COSPLAT_ASSERT(offsetof(struct cosplat_journal_header, step) == 0, "cosplat_journal_header");
COSPLAT_ASSERT(offsetof(struct cosplat_journal_header, epoch) == 8, "cosplat_journal_header");
COSPLAT_ASSERT(offsetof(struct cosplat_journal_header, first) == 16, "cosplat_journal_header");
COSPLAT_ASSERT(offsetof(struct cosplat_journal_header, count) == 24, "cosplat_journal_header");
COSPLAT_ASSERT(offsetof(struct cosplat_journal_header, reserved) == 28, "cosplat_journal_header");

/** Newest status of the server. */
struct cosplat_status {
    /** Steps completed. */
    uint64_t step;
    /** Simulated time [s]. */
    double sim_time;
    /** `CLOCK_MONOTONIC` of this update [ns]; a client that sees it stand still calls the server dead. */
    uint64_t heartbeat_ns;
    /** Identifies the published scene. */
    uint64_t epoch;
    /** Steps per wall second, mean over about the last second [1/s]. */
    double steps_per_second;
    /** Simulated seconds per wall second, same window. */
    double real_time_factor;
    /** Particle-substeps executed / those of full MPM, since start. */
    double modelled_fraction;
    /** Smallest substep of the last step [s]. */
    double dt;
    /** Kinetic energy [J]. */
    double kinetic_energy;
    /** Elastic energy [J]. */
    double elastic_energy;
    /** Potential energy [J]. */
    double potential_energy;
    /** Linear momentum [kg m/s]. */
    double linear_momentum[3];
    /** Angular momentum about the origin [kg m^2/s]. */
    double angular_momentum[3];
    /** Frames published. */
    uint64_t frames_published;
    /** Frames not published because no memory was free. */
    uint64_t frames_skipped;
    /** Substeps rolled back. */
    uint64_t rollbacks;
    /** Particles that left the domain. */
    uint64_t particles_left;
    /** Particles quarantined. */
    uint64_t particles_quarantined;
    /** Commands accepted. */
    uint64_t commands_accepted;
    /** Commands refused. */
    uint64_t commands_refused;
    /** Hash of the state after the last step. */
    uint64_t state_hash;
    /** What limited `dt`: 0 frame, 1 sound speed, 2 velocity, 3 deformation. */
    uint32_t dt_limit;
    /** Object that limited `dt`; `u32::MAX` = none. */
    uint32_t dt_object;
    /** `SERVER_*`. */
    uint32_t server_state;
    /** Server's process id. */
    uint32_t pid;
    /** Readers of `frame` and of `changes`. */
    uint32_t frame_readers;
    /** Whether the server sends `changes` to those who read it: 1, else 0. */
    uint32_t has_changes;
    /** Work that springs of clients did on what they hold, since start [J]. */
    double spring_work;
    /** Energy that edits brought into the world, since start [J]. */
    double edit_energy;
    /** Mass that edits brought into the world, since start [kg]. */
    double edit_mass;
    /** Wall time of a step, mean over about the last second; 0 while nothing is known [s]. */
    double step_seconds;
    /** Shares of it, 0..=1: particles, grid, contact on the grid, coupling, solids, their contact, measuring them, rigid bodies, sort, publish; what is left to 1 is between them. */
    double phase_shares[10];
    /** Shares of the processor time of all objects, 0..=1, of the three that take most, the dearest first, over the same steps. */
    double cost_shares[3];
    /** Their substeps per step. */
    double cost_substeps[3];
    /** The smallest of these; 0 where there are none [s]. */
    double cost_dt[3];
    /** Which objects they are; `u32::MAX` = none. */
    uint32_t cost_objects[3];
    /** What limited `cost_dt`, as `dt_limit`. */
    uint32_t cost_limits[3];
    /** Most points of their surfaces that touched something where a step ended; 0 where that is not known. */
    uint32_t cost_points[3];
    /** Zero. */
    uint32_t reserved;
};
#define COSPLAT_STATUS_TYPE_NAME "cosplat.v1.Status"
COSPLAT_ASSERT(sizeof(struct cosplat_status) == 448, "cosplat_status");
COSPLAT_ASSERT(COSPLAT_ALIGNOF(struct cosplat_status) == 8, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, step) == 0, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, sim_time) == 8, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, heartbeat_ns) == 16, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, epoch) == 24, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, steps_per_second) == 32, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, real_time_factor) == 40, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, modelled_fraction) == 48, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, dt) == 56, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, kinetic_energy) == 64, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, elastic_energy) == 72, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, potential_energy) == 80, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, linear_momentum) == 88, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, angular_momentum) == 112, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, frames_published) == 136, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, frames_skipped) == 144, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, rollbacks) == 152, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, particles_left) == 160, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, particles_quarantined) == 168, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, commands_accepted) == 176, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, commands_refused) == 184, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, state_hash) == 192, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, dt_limit) == 200, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, dt_object) == 204, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, server_state) == 208, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, pid) == 212, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, frame_readers) == 216, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, has_changes) == 220, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, spring_work) == 224, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, edit_energy) == 232, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, edit_mass) == 240, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, step_seconds) == 248, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, phase_shares) == 256, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, cost_shares) == 336, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, cost_substeps) == 360, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, cost_dt) == 384, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, cost_objects) == 408, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, cost_limits) == 420, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, cost_points) == 432, "cosplat_status");
COSPLAT_ASSERT(offsetof(struct cosplat_status, reserved) == 444, "cosplat_status");

#endif

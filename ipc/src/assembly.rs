//! The whole frame from what changed: bodies are put where they are by one function, at both ends the same.

use std::collections::BTreeMap;

use bytemuck::Zeroable;

use crate::schema::{
    CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, ChangeSlot, ChangesHeader, FrameHeader,
    GaussianState, ObjectChange, row_slots,
};

/// Where an object's own frame is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Its origin [m], world frame.
    pub position: [f64; 3],
    /// World-from-own rotation, unit quaternion xyzw.
    pub rotation: [f64; 4],
}

impl Placement {
    /// Rotation matrix, row-major.
    fn matrix(&self) -> [[f64; 3]; 3] {
        let [x, y, z, w] = self.rotation;
        [
            [
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y - z * w),
                2.0 * (x * z + y * w),
            ],
            [
                2.0 * (x * y + z * w),
                1.0 - 2.0 * (x * x + z * z),
                2.0 * (y * z - x * w),
            ],
            [
                2.0 * (x * z - y * w),
                2.0 * (y * z + x * w),
                1.0 - 2.0 * (x * x + y * y),
            ],
        ]
    }

    /// Gaussians of the object's own frame in the world, bit for bit as every program that follows `docs/wire-format.md`
    /// has them: sums from left to right, no fused operation, centres in double precision, all else in single.
    ///
    /// # Panics
    /// When `own` and `world` differ in length.
    pub fn place(&self, own: &[GaussianState], world: &mut [GaussianState]) {
        assert_eq!(own.len(), world.len(), "Gaussians and their places");
        let r = self.matrix();
        let t = self.position;
        let m = r.map(|row| row.map(|x| x as f32));
        let q = self.rotation.map(|x| x as f32);
        for (own, world) in own.iter().zip(world) {
            let p = own.position.map(f64::from);
            let centre =
                |a: usize| (r[a][0] * p[0] + r[a][1] * p[1] + r[a][2] * p[2] + t[a]) as f32;
            *world = GaussianState {
                position: [centre(0), centre(1), centre(2)],
                covariance: turned(&m, &own.covariance),
                rotation: product(q, own.rotation),
                ..*own
            };
        }
    }
}

/// `M C M^T` for a symmetric `C`, each as xx xy xz yy yz zz.
#[inline(always)]
fn turned(m: &[[f32; 3]; 3], [xx, xy, xz, yy, yz, zz]: &[f32; 6]) -> [f32; 6] {
    let half = |a: usize| {
        let [x, y, z] = m[a];
        [
            x * xx + y * xy + z * xz,
            x * xy + y * yy + z * yz,
            x * xz + y * yz + z * zz,
        ]
    };
    let (a, b, c) = (half(0), half(1), half(2));
    let with = |h: [f32; 3], b: usize| h[0] * m[b][0] + h[1] * m[b][1] + h[2] * m[b][2];
    [
        with(a, 0),
        with(a, 1),
        with(a, 2),
        with(b, 1),
        with(b, 2),
        with(c, 2),
    ]
}

/// Product of quaternions xyzw: first `b`, then `a`.
#[inline(always)]
fn product([ax, ay, az, aw]: [f32; 4], [bx, by, bz, bw]: [f32; 4]) -> [f32; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// Why changes do not add up to a frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AssemblyError {
    /// Something between was missed.
    #[error("changes of step {step} build on step {since}, expected {}", expected.map_or("a complete message".into(), |step| step.to_string()))]
    Missed {
        /// Step of the message.
        step: u64,
        /// Step that it builds on.
        since: u64,
        /// Step of what there is.
        expected: Option<u64>,
    },
    /// A row says more than the message or the frame holds.
    #[error(
        "object {object}: {count} Gaussians from {first} on, in slots from {slot} on, do not fit a frame of {gaussians} and a message of {slots} slots"
    )]
    Range {
        /// Object of the row.
        object: u32,
        /// First Gaussian.
        first: u32,
        /// Gaussians.
        count: u32,
        /// Slot of the first.
        slot: u32,
        /// Gaussians in the frame.
        gaussians: usize,
        /// Slots in the message.
        slots: usize,
    },
    /// A place for an object whose form is unknown.
    #[error("object {object} is placed, but its form was not told")]
    NoForm {
        /// Object of the row.
        object: u32,
    },
    /// A kind that does not exist.
    #[error("change of object {object} is of kind {kind}, expected 1 to 3")]
    UnknownKind {
        /// Object of the row.
        object: u32,
        /// What it says.
        kind: u32,
    },
    /// A complete message that is not.
    #[error("a complete message has {actual} Gaussians, expected {expected}")]
    Incomplete {
        /// Gaussians in it.
        actual: usize,
        /// Gaussians in the frame.
        expected: usize,
    },
}

/// An object in its own frame.
#[derive(Clone, Debug)]
struct Form {
    first: usize,
    gaussians: Vec<GaussianState>,
}

/// A frame that is kept up to date by what changes.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    gaussians: Vec<GaussianState>,
    forms: BTreeMap<u32, Form>,
    header: Option<FrameHeader>,
}

impl Assembly {
    /// The Gaussians, in the order of `frame`.
    pub fn gaussians(&self) -> &[GaussianState] {
        &self.gaussians
    }

    /// Header of the frame that there is; `None` before a complete message.
    pub fn header(&self) -> Option<&FrameHeader> {
        self.header.as_ref()
    }

    /// Takes over a message of `changes`.
    ///
    /// # Errors
    /// See [`AssemblyError`]; then a complete message has to come.
    pub fn apply(
        &mut self,
        header: &ChangesHeader,
        slots: &[ChangeSlot],
    ) -> Result<(), AssemblyError> {
        let before = self.header.take().map(|h| (h.epoch, h.step));
        if header.is_complete() {
            self.begin(header.gaussians as usize);
        } else if before != Some((header.epoch, header.since))
            || self.gaussians.len() != header.gaussians as usize
        {
            return Err(AssemblyError::Missed {
                step: header.step,
                since: header.since,
                expected: before.map(|(_, step)| step),
            });
        }
        let mut told = 0;
        for change in rows(header, slots) {
            told += change.count as usize;
            let gaussians = change_gaussians(change, slots);
            let place = Placement {
                position: change.position,
                rotation: change.rotation,
            };
            let (object, first) = (change.object, change.first as usize);
            let fits = match (change.kind, gaussians) {
                (CHANGE_GAUSSIANS, Some(gaussians)) => self.set(first, gaussians),
                (CHANGE_FORM, Some(own)) => self.form(object, first, own, &place),
                (CHANGE_PLACED, _) => match self.place(object, &place) {
                    true => Some(()),
                    false => return Err(AssemblyError::NoForm { object }),
                },
                (CHANGE_GAUSSIANS | CHANGE_FORM, None) => None,
                (kind, _) => return Err(AssemblyError::UnknownKind { object, kind }),
            };
            fits.ok_or(AssemblyError::Range {
                object,
                first: change.first,
                count: change.count,
                slot: change.slot,
                gaussians: self.gaussians.len(),
                slots: slots.len(),
            })?;
        }
        if header.is_complete() && told != self.gaussians.len() {
            return Err(AssemblyError::Incomplete {
                actual: told,
                expected: self.gaussians.len(),
            });
        }
        self.header = Some(header.frame());
        Ok(())
    }

    /// Forgets all and begins a frame of `count` Gaussians.
    pub fn begin(&mut self, count: usize) {
        self.forms.clear();
        self.gaussians.clear();
        self.gaussians.resize(count, GaussianState::zeroed());
    }

    /// Puts Gaussians of the world frame in their places; `None` where these are beyond the frame.
    pub fn set(&mut self, first: usize, gaussians: &[GaussianState]) -> Option<()> {
        let places = self
            .gaussians
            .get_mut(first..first.checked_add(gaussians.len())?)?;
        places.copy_from_slice(gaussians);
        Some(())
    }

    /// Keeps an object in its own frame, and places it; `None` where its Gaussians are beyond the frame.
    pub fn form(
        &mut self,
        object: u32,
        first: usize,
        own: &[GaussianState],
        place: &Placement,
    ) -> Option<()> {
        self.keep(object, first, own)?;
        self.place(object, place);
        Some(())
    }

    /// Keeps an object in its own frame, to be placed; `None` where its Gaussians are beyond the frame.
    pub fn keep(&mut self, object: u32, first: usize, own: &[GaussianState]) -> Option<()> {
        self.gaussians.get(first..first.checked_add(own.len())?)?;
        let form = Form {
            first,
            gaussians: own.to_vec(),
        };
        self.forms.insert(object, form);
        Some(())
    }

    /// Moves an object as a whole; false where its form is unknown.
    pub fn place(&mut self, object: u32, place: &Placement) -> bool {
        let Some(form) = self.forms.get(&object) else {
            return false;
        };
        let places = form.first..form.first + form.gaussians.len();
        place.place(&form.gaussians, &mut self.gaussians[places]);
        true
    }
}

/// The rows of a message; none where it is too short for them.
pub fn rows<'a>(header: &ChangesHeader, slots: &'a [ChangeSlot]) -> &'a [ObjectChange] {
    let count = header.objects as usize;
    let Some(slots) = slots.get(..row_slots(count)) else {
        return &[];
    };
    let bytes: &[u8] = bytemuck::cast_slice(slots);
    bytemuck::cast_slice(&bytes[..count * size_of::<ObjectChange>()])
}

/// The Gaussians of a row; `None` where they are beyond the message.
pub fn change_gaussians<'a>(
    change: &ObjectChange,
    slots: &'a [ChangeSlot],
) -> Option<&'a [GaussianState]> {
    let (slot, count) = (change.slot as usize, change.count as usize);
    Some(bytemuck::cast_slice(
        slots.get(slot..slot.checked_add(count)?)?,
    ))
}

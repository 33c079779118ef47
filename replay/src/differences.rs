//! What of a recorded step differs from the same step simulated again, in words.

use bytemuck::pod_read_unaligned;
use cosplat_ipc::schema::{
    FieldLayout, FrameHeader, GaussianState, ObjectState, ObjectsHeader, Wire, command_name,
};
use cosplat_recorder::{messages::JournalEntry, messages::is_added, runs::RunHeader};
use cosplat_server::convert::object_to_wire;
use cosplat_sim_core::StepReport;

/// Objects that are described; of more only the number is said.
const MOST_OBJECTS: usize = 3;

/// What the recording holds of one step.
#[derive(Default)]
pub struct Seen {
    /// The step.
    pub step: u64,
    /// Objects, where they are recorded.
    pub objects: Option<(ObjectsHeader, Vec<ObjectState>)>,
    /// Frame, where it is recorded.
    pub frame: Option<(FrameHeader, Vec<GaussianState>)>,
    /// Commands that took effect at its start.
    pub commands: Vec<JournalEntry>,
}

impl Seen {
    /// Whether there is something to compare.
    pub fn is_empty(&self) -> bool {
        self.objects.is_none() && self.frame.is_none()
    }

    /// Everything that differs from the step simulated again, in sentences; nothing when all agrees.
    pub fn differences(
        &self,
        run: &RunHeader,
        report: &StepReport,
        gaussians: &[GaussianState],
    ) -> Vec<String> {
        let mut found = Vec::new();
        let hashes = [
            self.objects.as_ref().map(|(header, _)| header.state_hash),
            self.frame.as_ref().map(|(header, _)| header.state_hash),
        ];
        // An older recorder wrote no hash with the objects.
        let hash = |hash: &u64| *hash != 0 && *hash != report.state_hash;
        if let Some(recorded) = hashes.into_iter().flatten().find(hash) {
            found.push(format!(
                "the state hash is {recorded:016x}, simulated again {:016x}",
                report.state_hash
            ));
        }
        if let Some((header, recorded)) = &self.frame {
            found.extend(header_differences(header, report));
            found.extend(gaussian_differences(run, recorded, gaussians));
        }
        if let Some((_, recorded)) = &self.objects {
            found.extend(object_differences(run, recorded, report));
        }
        if !found.is_empty() {
            found.extend(self.commands.iter().map(|entry| {
                let command = &entry.applied.command;
                format!(
                    "at its start a command took effect: {}, number {} of client {:016x}",
                    command_name(command.kind),
                    command.sequence,
                    entry.applied.client
                )
            }));
        }
        found
    }
}

fn header_differences(recorded: &FrameHeader, report: &StepReport) -> Vec<String> {
    let numbers = [
        ("simulated time [s]", recorded.sim_time, report.sim_time),
        ("last substep [s]", recorded.dt, report.dt),
        (
            "number of substeps",
            recorded.substeps.into(),
            report.substeps.into(),
        ),
    ];
    numbers
        .iter()
        .filter(|(_, a, b)| !is_same(*a, *b))
        .map(|(name, a, b)| format!("the {name} is {a}, simulated again {b}"))
        .collect()
}

fn gaussian_differences(
    run: &RunHeader,
    recorded: &[GaussianState],
    simulated: &[GaussianState],
) -> Option<String> {
    if recorded.len() != simulated.len() {
        return Some(format!(
            "the frame has {} Gaussians, simulated again {}",
            recorded.len(),
            simulated.len()
        ));
    }
    let differs = |(a, b): &(&GaussianState, &GaussianState)| {
        bytemuck::bytes_of(*a) != bytemuck::bytes_of(*b)
    };
    let mut pairs = recorded.iter().zip(simulated).filter(differs);
    let (a, b) = pairs.next()?;
    Some(format!(
        "{} of {} Gaussians differ, the first is {} of object {:?}: at {:?} m, simulated again {:?} m",
        1 + pairs.count(),
        recorded.len(),
        b.index,
        run.object(b.object),
        a.position,
        b.position
    ))
}

fn object_differences(
    run: &RunHeader,
    recorded: &[ObjectState],
    report: &StepReport,
) -> Vec<String> {
    if recorded.len() != report.objects.len() {
        let count = report.objects.len();
        return vec![format!(
            "there are {} objects, simulated again {count}",
            recorded.len()
        )];
    }
    let pairs = recorded.iter().zip(&report.objects).enumerate();
    let differing: Vec<_> = pairs
        .filter_map(|(id, (a, state))| {
            let b = object_to_wire(id, state);
            let (name, a, b) = differing_field(a, &b)?;
            let object = run.object(id as u32);
            Some(format!(
                "object {object:?}: its {name} is {a:?}, simulated again {b:?}"
            ))
        })
        .collect();
    let more = differing.len().saturating_sub(MOST_OBJECTS);
    let rest = (more > 0).then(|| format!("{more} more objects differ"));
    differing
        .into_iter()
        .take(MOST_OBJECTS)
        .chain(rest)
        .collect()
}

/// The first field in which two values of a wire type differ, by the table of its layout, and what both have there. A field that
/// older recorders did not write is compared where something is recorded.
pub(crate) fn differing_field<W: Wire>(a: &W, b: &W) -> Option<(&'static str, Vec<f64>, Vec<f64>)> {
    W::FIELDS.iter().find_map(|field| {
        let [x, y] = [a, b].map(|value| &bytemuck::bytes_of(value)[field.offset..][..field.size]);
        let [a, b] = [x, y].map(|bytes| numbers(field, bytes));
        let is_told = !is_added(field) || x.iter().any(|byte| *byte != 0);
        // Of whole numbers beyond 2^53 the bytes alone tell.
        let is_same = match field.field_type.contains('f') {
            true => a.iter().zip(&b).all(|(a, b)| is_same(*a, *b)),
            false => x == y,
        };
        (is_told && !is_same).then_some((field.field, a, b))
    })
}

/// The numbers of a field.
fn numbers(field: &FieldLayout, bytes: &[u8]) -> Vec<f64> {
    let of = field.field_type.trim_start_matches('[');
    match &of[..of.len().min(3)] {
        "f64" => bytes.chunks_exact(8).map(pod_read_unaligned).collect(),
        "f32" => bytes
            .chunks_exact(4)
            .map(|b| f64::from(pod_read_unaligned::<f32>(b)))
            .collect(),
        "u64" => bytes
            .chunks_exact(8)
            .map(|b| pod_read_unaligned::<u64>(b) as f64)
            .collect(),
        "u32" => bytes
            .chunks_exact(4)
            .map(|b| f64::from(pod_read_unaligned::<u32>(b)))
            .collect(),
        _ => bytes.iter().map(|byte| f64::from(*byte)).collect(),
    }
}

/// Same bits, or two numbers that JSON cannot hold.
fn is_same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || !(a.is_finite() || b.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_differing_field_is_named_with_both_values() {
        let a = ObjectState {
            radius: 0.5,
            kinetic_energy: f64::NAN,
            ..ObjectState::default()
        };
        let b = ObjectState {
            elastic_energy: 2.0,
            kinetic_energy: f64::INFINITY,
            ..a
        };
        assert_eq!(differing_field(&a, &a), None);
        let expected = ("elastic_energy", vec![0.0], vec![2.0]);
        assert_eq!(differing_field(&a, &b), Some(expected));
        let b = ObjectState {
            com: [-0.0; 3],
            ..a
        };
        let (name, ..) = differing_field(&a, &b).expect("another sign");
        assert_eq!(name, "com");
        // No field of the wire is left out.
        for (n, field) in ObjectState::FIELDS.iter().enumerate() {
            let mut bytes = [0; size_of::<ObjectState>()];
            bytes[field.offset] = 1;
            let b = pod_read_unaligned::<ObjectState>(&bytes);
            let found = differing_field(&ObjectState::default(), &b);
            assert_eq!(found.map(|(name, ..)| name), Some(field.field), "field {n}");
        }
    }
}

//! Probes of a scene file with object numbers in place of names.

use cosplat_sim_core::scene::{Probe, ProbeKind};

use super::{
    error::Finding,
    ids::ObjectIds,
    spec::{ProbeKindSpec, ProbeSpec},
};

/// The probes; notes those of objects that do not exist.
pub(super) fn build(specs: &[ProbeSpec], ids: &ObjectIds, errors: &mut Vec<Finding>) -> Vec<Probe> {
    let mut probe = |spec: &ProbeSpec| {
        let mut number = |name: &str| ids.find(name, &spec.at, errors);
        let kind = match &spec.kind {
            ProbeKindSpec::Extent { object, share } => ProbeKind::Extent {
                object: number(object)?,
                share: *share,
            },
            ProbeKindSpec::Point { position } => ProbeKind::Point {
                position: *position,
            },
            ProbeKindSpec::Deviation {
                object,
                position,
                bounds,
            } => ProbeKind::Deviation {
                object: number(object)?,
                position: position.clone(),
                bounds: *bounds,
            },
            ProbeKindSpec::MaterialPoint { object, position } => ProbeKind::MaterialPoint {
                object: number(object)?,
                position: *position,
            },
        };
        Some(Probe {
            name: spec.name.clone(),
            kind,
        })
    };
    specs.iter().filter_map(&mut probe).collect()
}

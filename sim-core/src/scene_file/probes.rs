//! Probes of a scene file with object numbers in place of names.

use super::{
    error::{Finding, suggest},
    spec::{ProbeKindSpec, ProbeSpec},
};
use crate::scene::{Object, Probe, ProbeKind};

/// Notes probes of objects that do not exist; `names` are those of all objects.
pub(super) fn check(probes: &[ProbeSpec], names: &[&str], errors: &mut Vec<Finding>) {
    for probe in probes {
        let (ProbeKindSpec::Extent { object }
        | ProbeKindSpec::Deviation { object, .. }
        | ProbeKindSpec::MaterialPoint { object, .. }) = &probe.kind
        else {
            continue;
        };
        if !names.contains(&object.as_str()) {
            let hint = suggest(object, names.iter().copied());
            let message = format!("object `{object}` does not exist: {hint}");
            errors.push(Finding::new(&probe.at, message));
        }
    }
}

/// A probe with object numbers; names were checked before.
pub(super) fn probe(spec: &ProbeSpec, objects: &[Object]) -> Probe {
    let number = |name: &str| objects.iter().position(|o| o.name == name).unwrap_or(0);
    let kind = match &spec.kind {
        ProbeKindSpec::Extent { object } => ProbeKind::Extent {
            object: number(object),
        },
        ProbeKindSpec::Point { position } => ProbeKind::Point {
            position: *position,
        },
        ProbeKindSpec::Deviation {
            object,
            position,
            bounds,
        } => ProbeKind::Deviation {
            object: number(object),
            position: position.clone(),
            bounds: *bounds,
        },
        ProbeKindSpec::MaterialPoint { object, position } => ProbeKind::MaterialPoint {
            object: number(object),
            position: *position,
        },
    };
    Probe {
        name: spec.name.clone(),
        kind,
    }
}

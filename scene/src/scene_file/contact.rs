//! Text to [`Contact`]: the method, friction and restitution of objects and pairs.

use cosplat_sim_core::scene::{
    Coherence, CoherentMode, Contact, ContactMethod, ContactSurface, PairRule, PairSurface,
};

use super::{
    error::{At, Finding, suggest},
    ids::ObjectIds,
    limits as l,
    objects::Names,
    reader::Table,
};

/// How objects meet; objects by name, because splitting makes objects.
#[derive(Clone, Debug, Default)]
pub struct ContactSpec {
    /// The method.
    pub method: ContactMethod,
    /// Pairs with rules of their own, and where they stand.
    pub pairs: Vec<(At, [String; 2], PairSurface)>,
}

/// Reads `contact` and `[[contact_pairs]]`.
pub(super) fn read(table: &Table, names: &Names) -> ContactSpec {
    let method = table
        .get("contact")
        .and_then(|e| e.choice(&ContactMethod::NAMES));
    let pairs = table.tables("contact_pairs");
    let pairs = pairs.iter().filter_map(|e| pair(e.table()?, names));
    ContactSpec {
        method: method.unwrap_or_default(),
        pairs: pairs.collect(),
    }
}

fn pair(table: Table, names: &Names) -> Option<(At, [String; 2], PairSurface)> {
    let at = table.at.clone();
    let stated = surface(&table);
    let surface = PairSurface {
        restitution: stated.restitution,
        friction: stated.friction_to_objects(),
    };
    let objects = table.required("objects").and_then(|entry| {
        let given: Vec<_> = entry.array()?.iter().map(|e| e.text()).collect();
        let &[Some(a), Some(b)] = given.as_slice() else {
            entry.error(format!("names {} objects, expected 2", given.len()));
            return None;
        };
        for name in [a, b].into_iter().filter(|name| !names.makes(name)) {
            let hint = suggest(name, names.all());
            entry.error(format!("object `{name}` does not exist: {hint}"));
        }
        if a == b {
            entry.error(format!("names `{a}` twice, expected two objects"));
        }
        Some([a.to_owned(), b.to_owned()])
    });
    table.finish();
    Some((at, objects?, surface))
}

/// The keys `restitution` and `friction`.
pub(super) fn surface(table: &Table) -> ContactSurface {
    let number = |key, bounds| table.get(key).and_then(|e| e.number(bounds));
    ContactSurface {
        restitution: number("restitution", l::RESTITUTION),
        friction: number("friction", l::FRICTION),
    }
}

/// The key `coherence` of an object: a rate, or a table of a rate and a mode.
pub(super) fn coherence(table: &Table) -> Option<Coherence> {
    let entry = table.get("coherence")?;
    let (rate, mode) = if entry.raw_table().is_some() {
        let table = entry.table()?;
        let rate = table.required("rate").and_then(|e| e.number(l::COHERENCE));
        let mode = table
            .get("mode")
            .and_then(|e| e.choice(&CoherentMode::NAMES));
        table.finish();
        (rate?, mode.unwrap_or_default())
    } else {
        (entry.number(l::COHERENCE)?, CoherentMode::default())
    };
    (rate > 0.0).then_some(Coherence { rate, mode })
}

/// With object ids in place of names.
pub(super) fn build(spec: &ContactSpec, ids: &ObjectIds, errors: &mut Vec<Finding>) -> Contact {
    let mut pairs = Vec::with_capacity(spec.pairs.len());
    for (at, names, surface) in &spec.pairs {
        let found = [&names[0], &names[1]].map(|name| ids.find(name, at, errors));
        if let [Some(a), Some(b)] = found {
            pairs.push(PairRule {
                objects: [a, b],
                surface: *surface,
            });
        }
    }
    Contact {
        method: spec.method,
        pairs,
    }
}

#[cfg(test)]
mod tests {
    use cosplat_sim_core::scene::{Coherence, CoherentMode, ContactMethod, PairSurface};

    use super::super::{SceneFile, build};

    const OBJECTS: &str = "version = 1\ndx = 0.1\n\
        [[objects]]\nname = \"a\"\nshape = { kind = \"box\", size = [0.4, 0.4, 0.4] }\nmaterial = \"jelly\"\n\
        friction = 0.9\n\
        [[objects]]\nname = \"b\"\nclone = \"a\"\ntranslation = [1, 0, 0]\nrestitution = 0.5\n";

    fn scene(more: &str, before: &str) -> Result<cosplat_sim_core::scene::Scene, String> {
        let file =
            SceneFile::parse(&format!("{before}{OBJECTS}{more}")).map_err(|e| e.to_string())?;
        let load = &mut |_: &str| Err("there is no asset".into());
        let (scene, _) = build(&file, load).map_err(|e| e.to_string())?;
        Ok(scene)
    }

    #[test]
    fn method_surfaces_and_pairs_are_read() {
        let pair = "[[contact_pairs]]\nobjects = [\"b\", \"a\"]\nfriction = 0.2\n";
        let scene = scene(pair, "contact = \"multi_field\"\n").expect("valid");
        assert_eq!(scene.contact.method, ContactMethod::MultiField);
        assert_eq!(scene.objects[0].surface.friction, Some(0.9));
        let clone = &scene.objects[1].surface;
        assert_eq!((clone.friction, clone.restitution), (Some(0.9), Some(0.5)));
        let rule = PairSurface {
            restitution: None,
            friction: 0.2,
        };
        assert_eq!(scene.surface_between(0, 1), rule);
    }

    #[test]
    fn coherence_is_a_rate_or_a_table() {
        let read = |text: &str| scene(text, "").map(|scene| scene.objects[1].coherence);
        assert_eq!(read(""), Ok(None));
        let affine = Coherence {
            rate: 20.0,
            mode: CoherentMode::Affine,
        };
        assert_eq!(read("coherence = 20\n"), Ok(Some(affine)));
        let rigid = Coherence {
            mode: CoherentMode::Rigid,
            ..affine
        };
        let table = "coherence = { rate = 20.0, mode = \"rigid\" }\n";
        assert_eq!(read(table), Ok(Some(rigid)));
        assert_eq!(read("coherence = 0\n"), Ok(None));
        for (bad, expected) in [
            ("coherence = -1\n", "coherence"),
            ("coherence = { mode = \"rigid\" }\n", "rate"),
            ("coherence = { rate = 1, mode = \"stiff\" }\n", "affine"),
            ("coherence = { rate = 1, tau = 2 }\n", "tau"),
        ] {
            let error = read(bad).expect_err(bad);
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn mistakes_are_named() {
        for (text, before, expected) in [
            ("", "contact = \"glue\"\n", "two_scale"),
            (
                "[[contact_pairs]]\nobjects = [\"a\"]\n",
                "",
                "names 1 objects, expected 2",
            ),
            ("[[contact_pairs]]\nobjects = [\"a\", \"a\"]\n", "", "twice"),
            (
                "[[contact_pairs]]\nobjects = [\"a\", \"c\"]\n",
                "",
                "object `c` does not exist",
            ),
            (
                "[[contact_pairs]]\nobjects = [\"a\", \"a_7\"]\n",
                "",
                "object `a_7` does not exist",
            ),
            (
                "[[contact_pairs]]\nobjects = [\"a\", \"b\"]\nfriction = -1\n",
                "",
                "friction",
            ),
        ] {
            let error = scene(text, before).expect_err(expected);
            assert!(error.contains(expected), "{error}\nlacks: {expected}");
        }
    }
}

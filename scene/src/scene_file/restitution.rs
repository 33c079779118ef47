//! Restitution that a file states where matter bounces as its law and its loss have it.

use cosplat_sim_core::scene::{ContactMethod, Fidelity, Object, Scene};

use super::error::{At, Finding};

/// Places in a file of what may state restitution, each in the order of the scene.
pub(super) struct Places<'a> {
    pub objects: &'a [&'a At],
    pub pairs: Vec<&'a At>,
    pub colliders: Vec<&'a At>,
}

/// Warnings about restitution without effect.
pub(super) fn without_effect(scene: &Scene, at: &Places<'_>) -> Vec<Finding> {
    // The paper's contact of spheres has a restitution, whatever objects are made of.
    if scene.contact.method == ContactMethod::ComSphere {
        return vec![];
    }
    let of_objects = scene.objects.iter().zip(at.objects);
    let of_objects = of_objects.filter_map(|(object, at)| of_object(scene, object, at));
    let of_pairs = scene.contact.pairs.iter().zip(&at.pairs);
    let of_pairs = of_pairs.filter_map(|(rule, at)| {
        let e = rule.surface.restitution?;
        let objects = rule.objects.map(|id| &scene.objects[id]);
        let matter = objects.into_iter().find(|object| object.is_matter())?;
        let [a, b] = objects.map(|object| &object.name);
        let said = format!("restitution {e} does not decide the bounces of `{a}` and `{b}`");
        Some(Finding::new(at, between_objects(&said, matter)))
    });
    let of_colliders = scene.colliders.iter().zip(&at.colliders);
    let of_colliders = of_colliders.filter_map(|(collider, at)| {
        let (name, e) = (&collider.name, collider.restitution);
        // Grains and drops bounce off as points, and rigid bodies as a whole.
        let bounces = |object: &Object| !object.is_matter() || !object.keeps_shape();
        let matter = simulated(scene).next()?;
        if e == 0.0 || simulated(scene).any(bounces) {
            return None;
        }
        let said = format!(
            "collider `{name}`: restitution {e} does not decide the bounces of {}: {}; `fidelity = \"rigid\"` gives a stated one",
            named(simulated(scene)),
            decides(matter)
        );
        Some(Finding::new(at, said))
    });
    of_objects.chain(of_pairs).chain(of_colliders).collect()
}

/// The warning about what an object states.
fn of_object(scene: &Scene, object: &Object, at: &At) -> Option<Finding> {
    let e = object.surface.restitution?;
    let others = || simulated(scene).filter(|other| !std::ptr::eq(*other, object));
    let is_matter = object.is_matter();
    // It is that of two rigid bodies where there is another one.
    if object.fidelity == Fidelity::Static || !is_matter && !others().all(Object::is_matter) {
        return None;
    }
    let matter = match is_matter {
        true => object,
        false => others().next()?,
    };
    let off = match others().next() {
        Some(_) => format!(" off {}", named(others())),
        None => String::new(),
    };
    let name = &object.name;
    let said = format!("object `{name}`: restitution {e} does not decide its bounces{off}");
    Some(Finding::new(at, between_objects(&said, matter)))
}

/// Objects that move and meet others.
fn simulated(scene: &Scene) -> impl Iterator<Item = &Object> {
    let objects = scene.objects.iter();
    objects.filter(|o| o.fidelity != Fidelity::Static && !o.particles.is_empty())
}

/// The first of some objects, and how many there are besides.
fn named<'a>(mut objects: impl Iterator<Item = &'a Object>) -> String {
    let first = objects.next().map_or("", |object| &object.name);
    match objects.count() {
        0 => format!("`{first}`"),
        more => format!("`{first}` and {more} more"),
    }
}

/// What decides where matter bounces.
fn decides(matter: &Object) -> String {
    let name = &matter.name;
    format!("the law of `{name}` and its `loss` decide")
}

fn between_objects(said: &str, matter: &Object) -> String {
    format!(
        "{said}: {}; `fidelity = \"rigid\"` of both or `contact = \"com_sphere\"` gives a stated one",
        decides(matter)
    )
}

#[cfg(test)]
mod tests {
    use crate::scene_file::{SceneFile, build};

    const HEAD: &str = "version = 1\ndx = 0.05\n";
    const A: &str =
        "[[objects]]\nname = \"a\"\nshape = { kind = \"box\", size = [0.2, 0.2, 0.2] }\n";
    const B: &str = "[[objects]]\nname = \"b\"\nshape = { kind = \"box\", size = [0.2, 0.2, 0.2] }\ntranslation = [1, 0, 0]\n";
    const JELLY: &str = "material = \"jelly\"\n";
    const RIGID: &str = "material = \"rigid\"\n";
    const E: &str = "restitution = 0.5\n";
    const FLOOR: &str = "[[colliders]]\nname = \"floor\"\nnormal = [0, 1, 0]\npoint = [0, -1, 0]\nrestitution = 0.5\n";
    const PAIR: &str = "[[contact_pairs]]\nobjects = [\"a\", \"b\"]\nrestitution = 0.5\n";

    /// What is said of restitution in a scene.
    fn said(parts: &[&str]) -> Vec<String> {
        let text = format!("{HEAD}{}", parts.concat());
        let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{text}{e}"));
        let built = build(&file, &mut |_| unreachable!("no files"));
        let (_, report) = built.unwrap_or_else(|e| panic!("{text}{e}"));
        let all = report.warnings.into_iter().map(|warning| warning.message);
        all.filter(|message| message.contains("restitution"))
            .collect()
    }

    #[test]
    fn matter_that_states_restitution_is_told_what_decides() {
        let stated: &[&[&str]] = &[&[A, JELLY, E, B, JELLY], &[A, JELLY, E, B, RIGID]];
        for parts in stated {
            assert_eq!(
                said(parts),
                [
                    "object `a`: restitution 0.5 does not decide its bounces off `b`: the law of `a` and its `loss` decide; \
                  `fidelity = \"rigid\"` of both or `contact = \"com_sphere\"` gives a stated one"
                ]
            );
        }
        let alone = said(&[A, JELLY, E]);
        assert!(
            alone[0].contains("not decide its bounces: the law"),
            "{alone:?}"
        );
        // A rigid body has nobody to bounce off with it.
        let told = said(&[A, JELLY, B, RIGID, E]);
        assert!(
            told[0].contains("object `b`") && told[0].contains("the law of `a`"),
            "{told:?}"
        );
    }

    #[test]
    fn pairs_and_colliders_name_both_parties() {
        let told = said(&[A, RIGID, B, JELLY, PAIR]);
        assert_eq!(told.len(), 1);
        assert!(
            told[0].contains("bounces of `a` and `b`: the law of `b`"),
            "{told:?}"
        );
        let told = said(&[A, JELLY, B, JELLY, FLOOR]);
        assert_eq!(told.len(), 1);
        let words = "collider `floor`: restitution 0.5 does not decide the bounces of `a` and 1 more: the law of `a`";
        assert!(told[0].starts_with(words), "{told:?}");
    }

    #[test]
    fn restitution_that_something_has_warns_of_nothing() {
        let sand = "material = \"dry_sand\"\n";
        let spheres = "contact = \"com_sphere\"\n";
        let effective: &[&[&str]] = &[
            &[A, RIGID, E, B, RIGID],
            &[A, RIGID, B, RIGID, PAIR],
            &[A, RIGID, B, JELLY, FLOOR],
            &[A, sand, FLOOR],
            &[spheres, A, JELLY, E, B, JELLY, PAIR],
            &[A, JELLY, "fidelity = \"rigid\"\n", E, B, RIGID, FLOOR],
        ];
        for parts in effective {
            assert_eq!(said(parts), Vec::<String>::new(), "{parts:?}");
        }
    }
}

//! Which grid the matter of objects is on whose entries in a scene file do not say.

use cosplat_sim_core::{
    World, WorldError,
    scene::{ContactMethod, Object, Scene, Solver, Transfer},
};

use super::{
    report::BuildReport,
    spec::{ObjectSpec, SceneFile},
};

/// Chooses for each entry of the file that does not say: grids of their own for its objects where all of them may have one;
/// `specs` are the entries of the scene's objects.
pub(super) fn choose(
    scene: &mut Scene,
    file: &SceneFile,
    specs: &[&ObjectSpec],
    report: &mut BuildReport,
) {
    let checked = World::check_lagrangian(scene);
    let objects = scene.objects.iter().zip(specs).zip(checked);
    let mut reasons: Vec<Option<String>> = objects
        .map(|((object, spec), checked)| why_spatial(scene, object, spec, checked))
        .collect();
    for entry in &file.objects {
        let own = |&id: &usize| std::ptr::eq(specs[id], entry);
        let own: Vec<usize> = (0..specs.len()).filter(own).collect();
        // What splitting makes is on grids of one kind.
        let reason = own.iter().find_map(|&id| reasons[id].clone());
        let is_matter = own.iter().any(|&id| scene.objects[id].is_matter());
        let chosen = match (entry.solver, &reason) {
            (Some(stated), _) => stated,
            (None, None) if is_matter => Solver::Lagrangian,
            (None, _) => Solver::Spatial,
        };
        for &id in &own {
            scene.objects[id].solver = chosen;
            if reasons[id].is_none() && chosen == Solver::Spatial {
                reasons[id].clone_from(&reason);
            }
        }
        report.chosen.push(entry.solver.is_none().then_some(chosen));
    }
    report.why_spatial = reasons;
}

/// Why an object is on the spatial grid; none where it may have a grid of its own, is said to have one, or is no matter.
fn why_spatial(
    scene: &Scene,
    object: &Object,
    spec: &ObjectSpec,
    checked: Result<(), WorldError>,
) -> Option<String> {
    if !object.is_matter() {
        return None;
    }
    match (spec.solver, checked) {
        (Some(Solver::Lagrangian), _) => None,
        (Some(Solver::Spatial), _) => Some("its entry says so".into()),
        (None, Err(WorldError::Solid { what, .. })) => {
            Some(format!("{what} does not go with a grid of its own"))
        }
        (None, Err(other)) => Some(other.to_string()),
        (None, Ok(())) => why_all_spatial(scene),
    }
}

/// Why all matter of a scene is on the spatial grid: what it asks for acts there alone.
fn why_all_spatial(scene: &Scene) -> Option<String> {
    let conditions = &scene.conditions;
    if conditions.transfer == Transfer::Pic {
        return Some("transfer = \"pic\" acts on the spatial grid alone".into());
    }
    if conditions.rpic_damping > 0.0 {
        return Some("rpic_damping acts on the spatial grid alone".into());
    }
    let method = match scene.contact.method {
        ContactMethod::TwoScale => return None,
        ContactMethod::SingleField => "single_field",
        ContactMethod::MultiField => "multi_field",
        ContactMethod::ComSphere => "com_sphere",
    };
    Some(format!(
        "contact = \"{method}\" acts on the spatial grid alone"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::build;

    const BLOCK: &str = "[[objects]]\nname = \"block\"\nshape = { kind = \"box\", size = [0.2, 0.2, 0.2] }\n\
                         material = \"jelly\"\n";
    const OTHER: &str =
        "[[objects]]\nname = \"other\"\nclone = \"block\"\ntranslation = [1, 0, 0]\n";

    fn built(rest: &str) -> (Scene, BuildReport) {
        let text = format!("version = 1\ndx = 0.05\n{rest}");
        let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{text}{e}"));
        build(&file, &mut |_| unreachable!("no files")).unwrap_or_else(|e| panic!("{text}{e}"))
    }

    /// Grids of all objects.
    fn solvers(scene: &Scene) -> Vec<Solver> {
        scene.objects.iter().map(|object| object.solver).collect()
    }

    #[test]
    fn what_keeps_its_shape_has_a_grid_of_its_own_by_default() {
        for law in [
            "\"rubber\"",
            "\"plasticine\"",
            "\"clay\"",
            "\"shaving_foam\"",
        ] {
            let material = format!("material = {law}");
            let (scene, report) = built(&BLOCK.replace("material = \"jelly\"", &material));
            assert_eq!(solvers(&scene), [Solver::Lagrangian], "{law}");
            assert_eq!(report.why_spatial, [None]);
            assert_eq!(World::check_scene(&scene), Ok(()), "{law}");
        }
        // What is no matter has no grid, and no reason.
        for words in [
            "fidelity = \"rigid\"",
            "fidelity = \"static\"",
            "present = true",
        ] {
            let material = match words {
                "present = true" => "material = \"rigid\"",
                _ => "material = \"jelly\"",
            };
            let text = BLOCK.replace("material = \"jelly\"", &format!("{words}\n{material}"));
            let (scene, report) = built(&text);
            assert_eq!(
                (solvers(&scene), report.why_spatial),
                (vec![Solver::Spatial], vec![None])
            );
        }
    }

    #[test]
    fn what_solids_do_not_do_leaves_objects_on_the_spatial_grid() {
        let sand = BLOCK.replace("jelly", "dry_sand");
        let part = format!(
            "{BLOCK}[[objects.regions]]\nmaterial = \"water\"\nbox = {{ min = [0, -1, -1], max = [1, 1, 1] }}\n"
        );
        for (text, words) in [
            (sand, "the law drucker_prager"),
            (part, "the law fluid"),
            (
                format!("contact = \"single_field\"\n{BLOCK}{OTHER}"),
                "single_field",
            ),
            (format!("contact = \"com_sphere\"\n{BLOCK}"), "com_sphere"),
            (format!("contact = \"multi_field\"\n{BLOCK}"), "multi_field"),
            (format!("transfer = \"pic\"\n{BLOCK}"), "transfer = \"pic\""),
            (format!("rpic_damping = 0.1\n{BLOCK}"), "rpic_damping"),
            (
                format!("{BLOCK}solver = \"spatial\"\n"),
                "its entry says so",
            ),
        ] {
            let (scene, report) = built(&text);
            for (object, why) in scene.objects.iter().zip(&report.why_spatial) {
                assert_eq!(object.solver, Solver::Spatial, "{text}");
                let why = why.as_ref().expect("a reason");
                assert!(why.contains(words), "{why}");
            }
            assert_eq!(World::check_scene(&scene), Ok(()), "{text}");
        }
        // Beside sand, and where it may sleep, it has a grid of its own.
        let beside = format!("{BLOCK}{OTHER}material = \"dry_sand\"\n");
        let (scene, report) = built(&beside);
        let both = [Solver::Lagrangian, Solver::Spatial];
        assert_eq!(
            (solvers(&scene), &report.why_spatial[0]),
            (both.to_vec(), &None)
        );
        let (scene, _) = built(&format!("{BLOCK}fidelity = \"auto\"\n"));
        assert_eq!(solvers(&scene), [Solver::Lagrangian]);
    }

    #[test]
    fn what_an_entry_says_is_kept() {
        let stated = format!("{BLOCK}solver = \"lagrangian\"\n").replace("jelly", "dry_sand");
        let (scene, report) = built(&stated);
        assert_eq!(solvers(&scene), [Solver::Lagrangian]);
        assert_eq!(
            (report.chosen, report.why_spatial),
            (vec![None], vec![None])
        );
        let error = World::check_scene(&scene).expect_err("no solid is of sand");
        assert!(matches!(error, WorldError::Solid { .. }), "{error}");
        // A clone has what its source says, and chooses for itself where that says nothing.
        let (scene, _) = built(&format!("{BLOCK}solver = \"spatial\"\n{OTHER}"));
        assert_eq!(solvers(&scene), [Solver::Spatial; 2]);
        let auto = format!("{BLOCK}{OTHER}solver = \"spatial\"\n");
        let (scene, report) = built(&auto);
        let both = [Solver::Lagrangian, Solver::Spatial];
        assert_eq!(solvers(&scene), both);
        assert_eq!(report.chosen, [Some(Solver::Lagrangian), None]);
    }
}

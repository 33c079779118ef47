//! Masks whose numbers mean nothing beyond their view: split, merged, with edges that are off.

use std::convert::Infallible;

use cosplat_semantics::{
    Evidence, Splat, evidence,
    grouping::group,
    lift::Labels,
    stand_in::{damaged, mask},
    views::spiral,
};
use glam::Vec3;

use crate::scenes::{self, Known};

const VIEWS: usize = 24;

/// Mean over true objects of the best IoU that a group of at least 200 Gaussians has, and how many such groups there are.
pub fn best(truth: &[i32], objects: usize, labels: &Labels) -> (f64, usize) {
    let groups = labels
        .object
        .iter()
        .max()
        .map_or(0, |most| *most as usize + 1);
    let mut both = vec![vec![0usize; groups]; objects];
    let (mut of_truth, mut of_group) = (vec![0; objects], vec![0; groups]);
    for (&object, &group) in truth.iter().zip(&labels.object) {
        both[object as usize][group as usize] += 1;
        of_truth[object as usize] += 1;
        of_group[group as usize] += 1;
    }
    let iou =
        |o: usize, g: usize| both[o][g] as f64 / (of_truth[o] + of_group[g] - both[o][g]) as f64;
    let best = |o: usize| (0..groups).map(|g| iou(o, g)).fold(0.0, f64::max);
    let mean = (0..objects).map(best).sum::<f64>() / objects as f64;
    (mean, of_group.iter().filter(|size| **size >= 200).count())
}

fn grouped(splat: &Splat, shown: &Known, up: Vec3, is_damaged: bool) -> Labels {
    let views = spiral(shown.splat.bounds(), up, VIEWS, 640, 480);
    let said: Vec<Vec<Evidence>> = views
        .iter()
        .enumerate()
        .map(|(n, view)| {
            let right = mask(&shown.splat, &shown.truth, shown.objects, &view.camera);
            let map = if is_damaged {
                damaged(&right, shown.objects, n)
            } else {
                right
            };
            evidence(splat, &view.camera, &map)
        })
        .collect();
    let Ok(labels) = group(splat, VIEWS, |n| Ok::<_, Infallible>(said[n].clone()));
    labels
}

/// Scores of a scene with right and with damaged masks; `shown` is what the masks are of.
fn scores(name: &str, scene: &Known, shown: &Known, up: Vec3) -> [(f64, usize); 2] {
    [false, true].map(|is_damaged| {
        let labels = grouped(&scene.splat, shown, up, is_damaged);
        let (iou, groups) = best(&scene.truth, scene.objects, &labels);
        println!(
            "{name}, damaged {is_damaged}: {iou:.4}, {groups} of {} objects",
            scene.objects
        );
        (iou, groups)
    })
}

/// The bar is 0.97 and the right number (docs/semantics.md).
fn check(objects: usize, iou: f64, groups: usize) {
    assert!(iou >= 0.97, "{iou}");
    assert_eq!(groups, objects, "groups of at least 200 Gaussians");
}

#[test]
fn toys_are_found_from_masks_without_names() {
    let Some(toys) = scenes::toys() else { return };
    for (iou, groups) in scores("toys", &toys, &toys, Vec3::Y) {
        check(toys.objects, iou, groups);
    }
}

#[test]
fn a_plant_is_one_object_though_its_leaves_are_apart() {
    let Some(plant) = scenes::plant() else { return };
    for (iou, groups) in scores("plant", &plant, &plant, Vec3::Y) {
        check(plant.objects, iou, groups);
    }
}

#[test]
fn masks_of_another_tier_of_a_robot_find_its_parts() {
    let Some(playbot) = scenes::playbot() else {
        return;
    };
    let Some(shown) = scenes::finer(&playbot) else {
        return;
    };
    for (iou, groups) in scores("cross", &playbot, &shown, Vec3::NEG_Y) {
        check(playbot.objects, iou, groups);
    }
}

//! Lines of nodes at planes: what is attached, what presses, what rubs.

use super::*;

/// Nodes along the first axis, all alike across it.
struct Row(Vec<(i32, f64, f64)>);

impl Nodes for Row {
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
        let found = self.0.iter().find(|(i, ..)| *i == index[0]);
        found.map(|&(_, m, v)| (m, [v, 0.5, 0.0]))
    }

    fn gap(&self, _: [i32; 3], _: usize) -> f64 {
        0.0
    }
}

fn wall(at: f64, side: i32, sticky: bool) -> Face {
    Face {
        constrained_axes: [true, sticky, sticky],
        ..Face::new(Owner::Body(0), 0, side, at, 1.0)
    }
}

#[test]
fn what_moves_in_proportion_to_the_distance_stays_as_it_is() {
    for at in [-0.5, -0.3, 0.0, 0.2, 0.49, 0.5, 0.8] {
        for side in [1, -1] {
            let face = wall(at, side, false);
            let speed = |i: i32| 0.7 * (f64::from(i) - at);
            let nodes = (-4..=4).map(|i| (i, 1.0 + 0.1 * f64::from(i * i), speed(i)));
            let nodes = Row(nodes.collect());
            let mut seen = 0;
            for i in -4..=4 {
                if let Some(found) = attached(&[face], [i, 0, 0], &nodes, 1.0, 1e-3) {
                    assert!((found.velocity[0] - speed(i)).abs() < 1e-12, "{at} {i}");
                    assert_eq!(found.velocity[1], 0.5);
                    seen += 1;
                }
            }
            assert_eq!(seen, 3);
        }
    }
}

#[test]
fn power_of_joint_motion_is_kept_and_energy_never_grows() {
    let nodes = Row(vec![
        (-1, 0.2, 0.9),
        (0, 0.6, -0.4),
        (1, 1.0, 0.3),
        (2, 1.0, 0.1),
    ]);
    let face = wall(0.1, 1, false);
    let after = |i: i32| attached(&[face], [i, 0, 0], &nodes, 1.0, 1e-3);
    assert_eq!(after(2), None);
    let energy = |v: &dyn Fn(i32) -> f64| {
        let nodes = nodes.0.iter().filter(|(i, ..)| *i < 2);
        nodes.map(|&(i, m, _)| m * v(i).powi(2)).sum::<f64>()
    };
    let before = energy(&|i| nodes.node([i, 0, 0]).map_or(0.0, |(_, v)| v[0]));
    let now = energy(&|i| after(i).map_or(0.0, |found| found.velocity[0]));
    assert!(now < before, "{now} {before}");
    // A projection: what is taken away is orthogonal, by mass, to what is left.
    let power: f64 = nodes.0[..3]
        .iter()
        .map(|&(i, m, v)| {
            let left = after(i).map_or(v, |found| found.velocity[0]);
            m * left * (v - left)
        })
        .sum();
    assert!(power.abs() < 1e-15, "{power}");
}

#[test]
fn a_slot_of_one_cell_holds_all_that_is_in_it() {
    let faces = [wall(0.0, 1, true), wall(1.0, -1, true)];
    let nodes = Row((-1..=2).map(|i| (i, 1.0, 2.0)).collect());
    for i in -1..=2 {
        let found = attached(&faces, [i, 0, 0], &nodes, 1.0, 1e-3).expect("both act");
        assert_eq!(found.velocity, [0.0; 3]);
    }
}

#[test]
fn in_a_slot_of_two_cells_the_middle_is_free() {
    let faces = [wall(0.0, 1, false), wall(2.0, -1, false)];
    let nodes = Row((-1..=3).map(|i| (i, 1.0, 1.0)).collect());
    let at = |i| attached(&faces, [i, 0, 0], &nodes, 1.0, 1e-3).map(|found| found.velocity[0]);
    // 1 - 1 - 1 over 1 + 1 + 1: both mirrored nodes move against the middle one.
    let middle = -1.0 / 3.0;
    assert_eq!(at(1), Some(middle));
    assert_eq!([at(0), at(2)], [Some(0.0); 2]);
    assert_eq!([at(-1), at(3)], [Some(-middle); 2]);
}

#[test]
fn friction_of_a_line_is_mu_times_its_normal_impulse() {
    let nodes = Row(vec![(-1, 0.2, -0.01), (0, 0.6, -0.02), (1, 1.0, -0.01)]);
    let face = Face {
        friction: 0.3,
        ..wall(0.0, 1, false)
    };
    let mut change = [0.0; 2];
    for &(i, m, v) in &nodes.0 {
        let found = attached(&[face], [i, 0, 0], &nodes, 1.0, 1e-3).expect("it touches");
        change[0] += m * (found.velocity[0] - v);
        change[1] += m * (found.velocity[1] - 0.5);
    }
    assert!(change[0] > 0.0);
    assert!((change[1] + 0.3 * change[0]).abs() < 1e-15, "{change:?}");
}

#[test]
fn pushes_and_friction_act_in_the_plane_and_not_where_nodes_are() {
    // So the arm of friction about the middle of a disk that lies on the plane is its radius.
    let mut pressed = 0;
    for at in [-0.5, -0.3, 0.0, 0.2, 0.49] {
        for (friction, releases) in [(0.3, true), (0.3, false), (10.0, true), (10.0, false)] {
            let face = Face {
                friction,
                releases,
                ..wall(at, 1, false)
            };
            let masses = [0.1, 0.2, 0.6, 1.0].into_iter();
            let nodes = Row((-2..=1).zip(masses).map(|(i, m)| (i, m, -0.02)).collect());
            let (mut sum, mut moment) = ([0.0; 2], [0.0; 2]);
            for &(i, m, v) in &nodes.0 {
                let Some(found) = attached(&[face], [i, 0, 0], &nodes, 1.0, 1e-3) else {
                    continue;
                };
                for (q, before) in [v, 0.5].into_iter().enumerate() {
                    let given = m * (found.velocity[q] - before);
                    sum[q] += given;
                    moment[q] += (f64::from(i) - at) * given;
                }
            }
            assert!(moment.iter().all(|m| m.abs() < 1e-15), "{at}: {moment:?}");
            if friction < 1.0 {
                assert!((sum[1] + friction * sum[0]).abs() < 1e-15, "{at}: {sum:?}");
            }
            pressed += usize::from(sum[0] > 0.0);
        }
    }
    assert_eq!(pressed, 20);
}

#[test]
fn a_separating_surface_gives_the_nearest_allowed_by_mass() {
    let mut seed = 1;
    let mut random = || crate::test_scenes::random(&mut seed);
    let mut seen = [0; 4];
    for _ in 0..2000 {
        let face = Face {
            releases: true,
            ..wall(random(), 1, false)
        };
        let line = [0; 3].map(|_| (0.5 * (random() + 1.0), [random(), 0.0, 0.0]));
        let max_closing_speed = (0.2 * random()).max(0.0);
        let (speed, given) = face.clamp_inward(&line, max_closing_speed);
        // The conditions of Karush, Kuhn and Tucker, with the plane coming towards matter at `max_closing_speed`.
        let after = speed.map(|speed| speed + max_closing_speed);
        let change: [f64; 3] = std::array::from_fn(|n| line[n].0 * (speed[n] - line[n].1[0]));
        let mut carried = 0.0;
        for n in [1, 2] {
            let beyond = after[n] - face.share[n] * after[0];
            assert!(beyond > -1e-12, "{line:?}: {beyond}");
            assert!(change[n] > -1e-12 && change[n] * beyond < 1e-12, "{line:?}");
            carried += face.share[n] * change[n];
        }
        assert!((change[0] + carried).abs() < 1e-12, "{line:?}");
        assert!((given - change.iter().sum::<f64>()).abs() < 1e-12);
        seen[usize::from(change[1] > 1e-12) + 2 * usize::from(change[2] > 1e-12)] += 1;
    }
    assert!(seen.iter().all(|&count| count > 50), "{seen:?}");
}

/// Nothing that leaves is held.
#[test]
fn a_separating_surface_holds_even_pressure_alone() {
    let at = |speed: f64, releases: bool| {
        let face = Face {
            releases,
            ..wall(0.1, 1, false)
        };
        let nodes = Row((-1..=2).map(|i| (i, 1.0, speed)).collect());
        [-1, 0, 1].map(|i| {
            attached(&[face], [i, 0, 0], &nodes, 1.0, 1e-3)
                .expect("it touches")
                .velocity[0]
        })
    };
    for (free, held) in at(-1.0, true).into_iter().zip(at(-1.0, false)) {
        assert!((free - held).abs() < 1e-15);
    }
    assert_eq!(at(1.0, true), [1.0; 3]);
}

#[test]
fn friction_sticks_up_to_the_coefficient() {
    // Pressed at 1, sliding at 0.5: with much friction as if attached, with none as it was.
    let nodes = Row(vec![(-1, 0.2, -1.0), (0, 0.6, -1.0), (1, 1.0, -1.0)]);
    let at = |friction: f64, sticky: bool| {
        let face = Face {
            friction,
            releases: !sticky,
            ..wall(0.1, 1, sticky)
        };
        [-1, 0, 1].map(|i| {
            attached(&[face], [i, 0, 0], &nodes, 1.0, 1e-3)
                .expect("it touches")
                .velocity[1]
        })
    };
    assert_eq!(at(0.0, false), [0.5; 3]);
    for (rough, sticky) in at(10.0, false).into_iter().zip(at(0.0, true)) {
        assert!((rough - sticky).abs() < 1e-15, "{rough} {sticky}");
    }
}

#[test]
fn friction_of_one_boundary_leaves_what_another_holds() {
    // In a corner of a rough floor and a rough wall, both of which let go: nothing moves into either.
    let faces = [0, 1].map(|axis| Face {
        axis,
        releases: true,
        friction: 0.7,
        ..wall(0.2, 1, false)
    });
    struct Block;
    impl Nodes for Block {
        fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
            let mass = if index[0] > 0 && index[1] > 0 {
                1.0
            } else {
                0.3
            };
            Some((mass, [-0.2, -0.5, 0.4]))
        }

        fn gap(&self, _: [i32; 3], _: usize) -> f64 {
            0.0
        }
    }
    let rough = attached(&faces, [0, 0, 0], &Block, 1.0, 1e-3)
        .expect("it touches")
        .velocity;
    let smooth = faces.map(|face| Face {
        friction: 0.0,
        ..face
    });
    let smooth = attached(&smooth, [0, 0, 0], &Block, 1.0, 1e-3)
        .expect("it touches")
        .velocity;
    assert_eq!(rough[..2], smooth[..2]);
    assert!(rough[2] < smooth[2] && rough[2] >= 0.0);
}

#[test]
fn a_line_at_once_is_its_nodes_one_by_one() {
    let mut seed = 5;
    let mut random = || crate::test_scenes::random(&mut seed);
    let mut acted = 0;
    for n in 0..600 {
        let releases = n % 3 == 0;
        let face = Face {
            releases,
            friction: [0.0, 0.3][n % 2],
            ..wall(random(), 1, n % 3 == 1)
        };
        // Some nodes have no matter.
        let all = (-4..5).filter(|_| random() > -0.8).collect::<Vec<i32>>();
        let nodes = Row(all.iter().map(|&i| (i, 1.1 + random(), random())).collect());
        let line = attached_line(&face, [0; 3], &nodes, 1.0, 1e-3);
        for rank in 0..3 {
            let index = face.behind([0; 3], rank);
            let Some((_, v)) = nodes.node(index) else {
                continue;
            };
            let alone = attached(&[face], index, &nodes, 1.0, 1e-3).map(|found| found.velocity);
            assert_eq!(line.map(|line| line[rank as usize]), alone, "{face:?}");
            acted += usize::from(alone.is_some_and(|alone| alone != v));
        }
    }
    assert!(acted > 500, "{acted}");
}

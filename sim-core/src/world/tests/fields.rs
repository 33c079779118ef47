//! Laws of grid fields: objects that do not share one do not know of each other.

use crate::{
    World,
    grid::NONE,
    materials::Law,
    scene::{ContactMethod, Scene},
    test_scenes::{add_box, elastic, empty},
};

/// Two soft boxes that pass through each other.
fn two_boxes(method: ContactMethod) -> Scene {
    let mut scene = empty(0.1);
    scene.contact.method = method;
    for (x, speed) in [(0.0, 1.0), (0.7, -1.0)] {
        let material = elastic(Law::NeoHookean, 1e4, 0.3);
        let id = add_box(&mut scene, material, [x, 0.01, 0.02], 0.05, [8; 3]);
        scene.objects[id].linear_velocity = [speed, 0.2, 0.0];
    }
    scene
}

#[test]
fn fields_share_places_where_node_blocks_of_both_exist() {
    let mut world = World::new(two_boxes(ContactMethod::MultiField)).expect("valid");
    world.step(1.0 / 60.0, &[]);
    let grid = &world.workspace.grid;
    assert!(grid.nodes.is_sorted_by_key(|n| (n.field, n.index)));
    let index_of = |field| {
        grid.nodes
            .iter()
            .filter(move |n| n.field == field)
            .map(|n| n.index)
    };
    let both: Vec<[i32; 3]> = index_of(0)
        .filter(|i| index_of(1).any(|j| j == *i))
        .collect();
    assert!(!both.is_empty() && both.len() < index_of(0).count());
    let shared: Vec<[i32; 3]> = grid.shared.iter().map(|s| s.index).collect();
    assert_eq!(shared, both, "both are ordered by index");
    for place in &grid.shared {
        let nodes = &grid.sharers[place.nodes.clone()];
        let fields: Vec<u32> = nodes
            .iter()
            .map(|&n| grid.nodes[n as usize].field)
            .collect();
        assert_eq!(fields, [0, 1]);
    }
    for node in &grid.nodes {
        for &tile in node.tiles.iter().filter(|&&t| t != NONE) {
            let block = &world.state.matter.particles.blocks[tile as usize];
            assert_eq!(block.field, node.field, "a tile of another field is summed");
        }
    }
}

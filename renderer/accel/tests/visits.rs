//! Visits of queries can be counted.

use treewright_accel::{Collapse, Ray, TreeParameters, Visits};

mod scenes;

use scenes::back_ends::tree;

fn wide() -> TreeParameters {
    TreeParameters {
        branching_factor: 8,
        min_leaf_size: 4,
        max_leaf_size: 8,
        max_depth: 64,
        collapse: Collapse::Optimal,
        ..TreeParameters::default()
    }
}

#[test]
fn counts_add_up_and_repeat() {
    let triangles = scenes::city(12, 5);
    let rays = scenes::rays(300, 7);
    for robust in [false, true] {
        for block_width in [4, 8] {
            let tree = tree(&triangles, &TreeParameters { robust, block_width, ..wide() });
            for any in [false, true] {
                let together = tree.visits(&rays, any);
                let mut one_by_one = Visits::default();
                rays.iter().for_each(|ray| one_by_one += tree.visits(std::slice::from_ref(ray), any));
                assert_eq!(together, one_by_one);
                assert_eq!(together, tree.visits(&rays, any));
                assert!(together.nodes >= rays.len() as u64, "each ray looks into the root");
                assert!(together.blocks > 0 && together.bytes > 256 * together.nodes);
            }
        }
    }
}

#[test]
fn rays_that_are_none_visit_nothing() {
    let tree = tree(&scenes::city(4, 5), &wide());
    let none = Ray { t_min: f32::NAN, ..scenes::rays(1, 1)[0] };
    assert_eq!(tree.visits(&[none], false), Visits::default());
    assert_eq!(tree.visits(&[none], true), Visits::default());
}

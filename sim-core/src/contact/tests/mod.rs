//! Laws of contact between deformable objects.

mod disks;
mod separation;

use crate::{
    World,
    materials::Law,
    scene::{ContactMethod, Scene},
    test_scenes::{add_box, elastic, empty},
};

//! Signed distance and outward normal of balls, boxes and cylinders, each in its own frame.

use crate::mat3::dot;

/// Signed distance, negative inside, and the unit vector along which it grows fastest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Signed, negative inside.
    pub value: f64,
    /// Unit normal outwards.
    pub normal: [f64; 3],
}

/// `v` over its length, or x where it has none.
pub(super) fn unit(v: [f64; 3], length: f64) -> [f64; 3] {
    if length > 0.0 {
        v.map(|x| x / length)
    } else {
        [1.0, 0.0, 0.0]
    }
}

/// Distance from a ball about the origin.
pub(crate) fn ball(x: [f64; 3], radius: f64) -> Distance {
    let r = dot(x, x).sqrt();
    Distance {
        value: r - radius,
        normal: unit(x, r),
    }
}

/// Distance from a cuboid about the origin by half its edges.
pub(crate) fn box_distance(half: [f64; 3], x: [f64; 3]) -> Distance {
    let beyond: [f64; 3] = std::array::from_fn(|a| x[a].abs() - half[a]);
    let sign = x.map(|x| if x < 0.0 { -1.0 } else { 1.0 });
    let outside: [f64; 3] = std::array::from_fn(|a| sign[a] * beyond[a].max(0.0));
    let length = dot(outside, outside).sqrt();
    if length > 0.0 {
        return Distance {
            value: length,
            normal: unit(outside, length),
        };
    }
    // Inside the nearest face counts.
    let mut axis = 0;
    for a in 1..3 {
        if beyond[a] > beyond[axis] {
            axis = a;
        }
    }
    let mut normal = [0.0; 3];
    normal[axis] = sign[axis];
    Distance {
        value: beyond[axis],
        normal,
    }
}

/// Distance from a cylinder about the origin that stands along y.
pub(crate) fn cylinder_distance(radius: f64, half_height: f64, x: [f64; 3]) -> Distance {
    let r = x[0].hypot(x[2]);
    let radial = if r > 0.0 {
        [x[0] / r, 0.0, x[2] / r]
    } else {
        [1.0, 0.0, 0.0]
    };
    let up = if x[1] < 0.0 { -1.0 } else { 1.0 };
    let (out, above) = (r - radius, x[1].abs() - half_height);
    if out > 0.0 && above > 0.0 {
        let value = out.hypot(above);
        return Distance {
            value,
            normal: [
                radial[0] * out / value,
                up * above / value,
                radial[2] * out / value,
            ],
        };
    }
    if out > above {
        Distance {
            value: out,
            normal: radial,
        }
    } else {
        Distance {
            value: above,
            normal: [0.0, up, 0.0],
        }
    }
}

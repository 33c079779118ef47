//! Where solids, bodies and colliders stand, and by how much they come nearer to each other.

use crate::mat3::length;

/// Where something that moves is.
#[derive(Clone, Copy, Debug)]
pub struct Stand {
    /// [m]
    pub place: [f64; 3],
    /// Unit quaternion.
    pub turn: [f64; 4],
    /// How far from the place anything counts that turns [m].
    pub radius: f64,
}

impl Stand {
    /// How far any point of two things may have come nearer to the other since they stood elsewhere [m].
    pub(crate) fn nearer([now, then]: [&Self; 2], [other, other_then]: [&Self; 2]) -> f64 {
        let mut apart = [0.0; 3];
        for a in 0..3 {
            let way = now.place[a] - then.place[a];
            apart[a] = way - (other.place[a] - other_then.place[a]);
        }
        length(apart) + now.swept(then) + other.swept(other_then)
    }

    fn swept(&self, then: &Self) -> f64 {
        let norm = |sign: f64| -> f64 {
            let parts = self.turn.iter().zip(&then.turn);
            parts.map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>()
        };
        // A chord of a turn is at most twice as long as the difference of the quaternions times the radius.
        let turn = norm(1.0).min(norm(-1.0)).sqrt();
        2.0 * turn * self.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_that_move_together_come_no_nearer() {
        let rest = Stand {
            place: [0.0; 3],
            turn: [0.0, 0.0, 0.0, 1.0],
            radius: 2.0,
        };
        let moved = Stand {
            place: [0.3, 0.0, 0.0],
            ..rest
        };
        assert_eq!(Stand::nearer([&moved, &rest], [&moved, &rest]), 0.0);
        assert!((Stand::nearer([&moved, &rest], [&rest, &rest]) - 0.3).abs() < 1e-15);
        let (s, c) = 0.05_f64.sin_cos();
        for sign in [1.0, -1.0] {
            let turned = Stand {
                turn: [0.0, 0.0, sign * s, sign * c],
                ..rest
            };
            let nearer = Stand::nearer([&turned, &rest], [&rest, &rest]);
            // No less than the chord of a tenth of a radian at a radius of 2.
            let least = 4.0 * s;
            assert!((least..1.01 * least).contains(&nearer), "{nearer}");
        }
    }
}

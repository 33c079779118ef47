//! The static scene as a splat `.ply` (binary, little-endian, logarithmic scales, logit opacities, rotation w x y z):
//! the layout of the 3D Gaussian Splatting reference code, which every splat viewer opens.

use std::fmt::Write;

use cosplat_ipc::schema::GaussianRest;

/// Gaussians encoded per call of the sink.
const BATCH: usize = 4096;

/// A scene to be written as `.ply`.
pub struct PlyScene<'a> {
    /// Gaussians at rest.
    pub gaussians: &'a [GaussianRest],
    /// Spherical-harmonics degree, 0..=3.
    pub sh_degree: u32,
    /// `[gaussian][coefficient][rgb]`; with any other length all colours are grey.
    pub sh: &'a [f32],
}

impl PlyScene<'_> {
    /// Coefficients per colour channel.
    fn coefficients(&self) -> usize {
        let bands = self.sh_degree.min(3) as usize + 1;
        bands * bands
    }

    /// Floats per Gaussian in the file: position, normal, coefficients, opacity, scale, rotation.
    fn floats(&self) -> usize {
        3 + 3 + 3 * self.coefficients() + 1 + 3 + 4
    }

    fn header(&self) -> String {
        let mut header = format!(
            "ply\nformat binary_little_endian 1.0\ncomment written by cosplat {}\nelement vertex {}\n",
            env!("CARGO_PKG_VERSION"),
            self.gaussians.len()
        );
        let mut property = |name: std::fmt::Arguments| {
            // Writing to a string cannot fail.
            let _ = writeln!(header, "property float {name}");
        };
        for name in ["x", "y", "z", "nx", "ny", "nz"] {
            property(format_args!("{name}"));
        }
        (0..3).for_each(|i| property(format_args!("f_dc_{i}")));
        (0..3 * (self.coefficients() - 1)).for_each(|i| property(format_args!("f_rest_{i}")));
        property(format_args!("opacity"));
        (0..3).for_each(|i| property(format_args!("scale_{i}")));
        (0..4).for_each(|i| property(format_args!("rot_{i}")));
        header.push_str("end_header\n");
        header
    }

    /// Size of the file [bytes].
    pub fn encoded_len(&self) -> u64 {
        self.header().len() as u64 + (self.gaussians.len() * self.floats() * 4) as u64
    }

    /// Hands the file to `sink` piece by piece.
    ///
    /// # Errors
    /// Those of `sink`.
    pub fn encode<E>(&self, mut sink: impl FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
        sink(self.header().as_bytes())?;
        let coefficients = self.coefficients();
        let stride = 3 * coefficients;
        let grey = vec![0.0; stride];
        let has_colour = self.sh.len() == self.gaussians.len() * stride;
        let mut buffer = Vec::with_capacity(BATCH * self.floats() * 4);
        for (batch, gaussians) in self.gaussians.chunks(BATCH).enumerate() {
            buffer.clear();
            for (i, gaussian) in gaussians.iter().enumerate() {
                let sh = match has_colour {
                    true => &self.sh[(batch * BATCH + i) * stride..][..stride],
                    false => &grey[..],
                };
                let mut put = |value: f32| buffer.extend_from_slice(&value.to_le_bytes());
                gaussian.position.into_iter().for_each(&mut put);
                [0.0; 3].into_iter().for_each(&mut put);
                sh[..3].iter().copied().for_each(&mut put);
                // The file has all red coefficients first, then green, then blue.
                for channel in 0..3 {
                    for coefficient in 1..coefficients {
                        put(sh[coefficient * 3 + channel]);
                    }
                }
                put(logit(gaussian.opacity));
                gaussian
                    .scale
                    .into_iter()
                    .for_each(|s| put(s.max(f32::MIN_POSITIVE).ln()));
                let [x, y, z, w] = gaussian.rotation;
                [w, x, y, z].into_iter().for_each(&mut put);
            }
            sink(&buffer)?;
        }
        Ok(())
    }
}

/// Inverse of the logistic function, finite at both ends: f32 cannot tell opacities this close to 0 or 1 apart.
fn logit(opacity: f32) -> f32 {
    let opacity = opacity.clamp(f32::EPSILON / 2.0, 1.0 - f32::EPSILON / 2.0);
    (opacity / (1.0 - opacity)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encode(scene: &PlyScene) -> Vec<u8> {
        let mut bytes = Vec::new();
        scene
            .encode(|piece| {
                bytes.extend_from_slice(piece);
                Ok::<_, ()>(())
            })
            .unwrap();
        bytes
    }

    #[test]
    fn coefficients_are_transposed_and_activations_inverted() {
        let gaussian = GaussianRest {
            position: [1.0, 2.0, 3.0],
            opacity: 0.75,
            scale: [0.5, 1.0, 2.0],
            object: 9,
            rotation: [0.1, 0.2, 0.3, 0.9],
        };
        let sh: Vec<f32> = (0..12).map(|i| i as f32).collect();
        let scene = PlyScene {
            gaussians: &[gaussian],
            sh_degree: 1,
            sh: &sh,
        };
        let bytes = encode(&scene);
        assert_eq!(bytes.len() as u64, scene.encoded_len());
        let end = b"end_header\n";
        let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let values: Vec<f32> = bytes[body..]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        assert_eq!(values[..9], [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0]);
        assert_eq!(
            values[9..18],
            [3.0, 6.0, 9.0, 4.0, 7.0, 10.0, 5.0, 8.0, 11.0]
        );
        // logit(3/4) = ln 3; one rounding each of the division and the logarithm.
        assert!((values[18] - 3f32.ln()).abs() < 2.0 * f32::EPSILON);
        assert_eq!(values[19..22], [0.5f32.ln(), 0.0, 2f32.ln()]);
        assert_eq!(values[22..], [0.9, 0.1, 0.2, 0.3]);
    }

    #[test]
    fn extreme_gaussians_stay_finite() {
        let gaussians = [0.0, 1.0].map(|opacity| GaussianRest {
            opacity,
            ..Default::default()
        });
        let scene = PlyScene {
            gaussians: &gaussians,
            sh_degree: 0,
            sh: &[],
        };
        let bytes = encode(&scene);
        let body = &bytes[bytes.len() - 2 * 17 * 4..];
        assert!(
            body.chunks_exact(4)
                .all(|b| f32::from_le_bytes(b.try_into().unwrap()).is_finite())
        );
    }
}

//! Which objects a word means: its vector against those of the objects.
//!
//! Relevancy is that of LERF (J. Kerr et al., ICCV 2023), as LangSplat has it: the least, over words that stand for anything, of
//! the chance that the query is meant rather than that word. Feature Splatting (R.-Z. Qiu et al., ECCV 2024) takes a softmax over
//! a list of words instead. Objects are asked, not Gaussians: one mean vector each.

use std::{collections::BTreeMap, path::Path};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use crate::{Evidence, SemanticsError, lift::Labels, objects::Vectors};

/// Words that stand for anything (LERF).
pub const NEGATIVES: [&str; 4] = ["object", "things", "stuff", "texture"];
/// Factor of cosines in the exponent (LERF).
const SHARPNESS: f32 = 10.0;
/// Relevancy above which an object is meant: that the query is meant rather than anything else (LERF).
pub const THRESHOLD: f32 = 0.5;
/// Contrast from which on an object is meant [standard deviations]. An absent word is no nearer to any of some twenty objects than
/// that by chance, and encoders differ in how near they put everything.
pub const CONTRAST: f32 = 5.0;
/// Fewer objects say nothing about what is usual.
pub const FEWEST: usize = 5;
/// Standard deviation of a normal distribution over its median deviation.
const FROM_MEDIAN: f32 = 1.4826;
/// Temperature of the softmax (Feature Splatting).
const TEMPERATURE: f32 = 0.05;

/// Vectors of words, as a text encoder makes them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words {
    /// Length of each vector.
    pub dim: usize,
    /// Unit vectors by word.
    pub vector: BTreeMap<String, Vec<f32>>,
}

/// The vector over its length; none where that is 0 or not finite.
pub fn unit(vector: &[f32]) -> Option<Vec<f32>> {
    // Squares of what `f32` holds are beyond it, at both ends.
    let squares = vector.iter().map(|x| f64::from(*x).powi(2));
    let length = squares.sum::<f64>().sqrt();
    let is_good = length.is_finite() && length > 0.0;
    is_good.then(|| {
        let whole = vector.iter().map(|x| f64::from(*x) / length);
        whole.map(|x| x as f32).collect()
    })
}

/// Cosine of two unit vectors.
fn cosine(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Words {
    /// Reads a safetensors file with one f32 vector for each word, by its name.
    ///
    /// # Errors
    /// When it cannot be read or has something else in it.
    pub fn read(path: &Path) -> Result<Self, SemanticsError> {
        let bytes = SemanticsError::content(path)?;
        Self::parse(&bytes).map_err(|why| SemanticsError::format(path, why))
    }

    /// As [`read`](Self::read), from the bytes of a file.
    ///
    /// # Errors
    /// When they are damaged or something else, in words.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let file = SafeTensors::deserialize(bytes)
            .map_err(|error| format!("no safetensors file of vectors by word: {error}"))?;
        let mut words = Words::default();
        for (word, tensor) in file.iter() {
            let shape = tensor.shape();
            let dim = shape.iter().product();
            if tensor.dtype() != Dtype::F32 || shape.len() != 1 || dim == 0 {
                return Err(format!(
                    "{word:?} is {:?} {shape:?}, expected F32 [d]",
                    tensor.dtype()
                ));
            }
            if words.dim != 0 && words.dim != dim {
                return Err(format!("{word:?} has {dim} values, expected {}", words.dim));
            }
            words.dim = dim;
            let values = tensor.data().as_chunks::<4>().0.iter();
            let vector: Vec<f32> = values.map(|b| f32::from_le_bytes(*b)).collect();
            let vector = unit(&vector)
                .ok_or_else(|| format!("{word:?} has no length, expected a finite one above 0"))?;
            words.vector.insert(word.to_owned(), vector);
        }
        match words.vector.is_empty() {
            true => Err("has no vectors".to_owned()),
            false => Ok(words),
        }
    }

    /// Writes the file that [`read`](Self::read) reads.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), SemanticsError> {
        let bytes = |v: &Vec<f32>| v.iter().flat_map(|x| x.to_le_bytes()).collect();
        let data: Vec<(&String, Vec<u8>)> =
            self.vector.iter().map(|(w, v)| (w, bytes(v))).collect();
        let tensors = data
            .iter()
            .map(|(word, bytes)| Ok((word, TensorView::new(Dtype::F32, vec![self.dim], bytes)?)));
        let file = tensors
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
            .and_then(|tensors| safetensors::serialize(tensors, None))
            .map_err(|error| SemanticsError::format(path, error.to_string()))?;
        cosplat_files::write(path, file).map_err(SemanticsError::write(path))
    }

    fn of(&self, word: &str) -> Option<&[f32]> {
        self.vector.get(word).map(Vec::as_slice)
    }

    /// How much each object is meant by `query` rather than by a word that stands for anything, 0..=1; more than a half where it
    /// is. `negatives` are those words. None where a word has no vector.
    pub fn relevancy(
        &self,
        objects: &Vectors,
        query: &str,
        negatives: &[&str],
    ) -> Option<Vec<f32>> {
        let meant = self.of(query)?;
        let others: Vec<&[f32]> = negatives
            .iter()
            .map(|n| self.of(n))
            .collect::<Option<_>>()?;
        let of = |n: usize| {
            let Some(own) = unit(objects.of(n)) else {
                return 0.0;
            };
            let q = cosine(&own, meant);
            let chance =
                |other: &&[f32]| 1.0 / (1.0 + (SHARPNESS * (cosine(&own, other) - q)).exp());
            others.iter().map(chance).fold(1.0, f32::min)
        };
        Some((0..count(objects)).map(of).collect())
    }

    /// How far each object stands out from the others by its cosine with `query`: the distance from their median, over what is
    /// usual (the median distance, as the standard deviation of a normal distribution) [standard deviations]. Objects without a
    /// vector are -infinity. None where the word has no vector, or fewer than [`FEWEST`] objects have one.
    pub fn contrast(&self, objects: &Vectors, query: &str) -> Option<Vec<f32>> {
        let meant = self.of(query)?;
        let of = |n: usize| unit(objects.of(n)).map(|own| cosine(&own, meant));
        let all: Vec<Option<f32>> = (0..count(objects)).map(of).collect();
        let known: Vec<f32> = all.iter().flatten().copied().collect();
        if known.len() < FEWEST {
            return None;
        }
        let middle = median(known.clone());
        let usual = median(known.iter().map(|c| (c - middle).abs()).collect()) * FROM_MEDIAN;
        let over = |c: &Option<f32>| match c {
            Some(c) => (c - middle) / usual.max(f32::MIN_POSITIVE),
            None => f32::NEG_INFINITY,
        };
        Some(all.iter().map(over).collect())
    }

    /// How much each object is meant by `query` among `list`, scaled so that the least is 0 and the most is 1 over the objects.
    /// None where a word has no vector.
    pub fn softmax(&self, objects: &Vectors, query: &str, list: &[&str]) -> Option<Vec<f32>> {
        let meant = self.of(query)?;
        let others: Vec<&[f32]> = list.iter().map(|n| self.of(n)).collect::<Option<_>>()?;
        let of = |n: usize| {
            let Some(own) = unit(objects.of(n)) else {
                return 0.0;
            };
            let q = cosine(&own, meant);
            let rest = others
                .iter()
                .map(|o| ((cosine(&own, o) - q) / TEMPERATURE).exp());
            1.0 / (1.0 + rest.sum::<f32>())
        };
        let all: Vec<f32> = (0..count(objects)).map(of).collect();
        let low = all.iter().copied().fold(f32::INFINITY, f32::min);
        let high = all.iter().copied().fold(0.0, f32::max);
        let scale = (high - low).max(f32::MIN_POSITIVE);
        Some(all.iter().map(|p| (p - low) / scale).collect())
    }
}

/// The value in the middle; of two, their mean.
fn median(mut of: Vec<f32>) -> f32 {
    of.sort_by(f32::total_cmp);
    match of.len() {
        0 => 0.0,
        n => 0.5 * (of[(n - 1) / 2] + of[n / 2]),
    }
}

fn count(objects: &Vectors) -> usize {
    objects.value.len() / objects.dim.max(1)
}

/// A unit vector for each of `objects` objects: the mean over the masks of all views of their vectors, each by the weight that
/// Gaussians of the object have in the mask. Zeros for an object that no mask covers.
#[derive(Clone, Debug)]
pub struct Means {
    objects: usize,
    dim: usize,
    sum: Vec<f64>,
}

impl Means {
    /// Nothing seen yet of `objects` objects.
    pub fn new(objects: usize) -> Self {
        Self {
            objects,
            dim: 0,
            sum: Vec::new(),
        }
    }

    /// Adds the masks of a view, number `n` with vector `n`.
    ///
    /// # Errors
    /// Where vectors are not as long as those before, in words.
    pub fn add(
        &mut self,
        view: &[Evidence],
        labels: &Labels,
        vectors: &Vectors,
    ) -> Result<(), String> {
        if self.sum.is_empty() {
            self.dim = vectors.dim;
            self.sum = vec![0.0; self.objects * self.dim];
        }
        if vectors.dim != self.dim {
            return Err(format!(
                "vectors have {} values, expected {}",
                vectors.dim, self.dim
            ));
        }
        let mut weight = BTreeMap::<(usize, usize), f64>::new();
        for e in view {
            let object = usize::try_from(labels.object[e.gaussian as usize]);
            if let (Ok(object), Ok(mask)) = (object, usize::try_from(e.mask)) {
                *weight.entry((object, mask)).or_default() += f64::from(e.weight);
            }
        }
        for ((object, mask), weight) in weight {
            let sum = &mut self.sum[object * self.dim..(object + 1) * self.dim];
            for (sum, value) in sum.iter_mut().zip(vectors.of(mask)) {
                *sum += weight * f64::from(*value);
            }
        }
        Ok(())
    }

    /// The vectors.
    pub fn finish(self) -> Vectors {
        let rows = self.sum.chunks(self.dim.max(1)).flat_map(|sum| {
            let mean: Vec<f32> = sum.iter().map(|s| *s as f32).collect();
            unit(&mean).unwrap_or(mean)
        });
        Vectors {
            dim: self.dim,
            value: rows.collect(),
        }
    }
}

/// Cosine of every object's vector with that of object `example`; 0 for one without a vector.
pub fn alike(objects: &Vectors, example: usize) -> Vec<f32> {
    let Some(meant) = unit(objects.of(example)) else {
        return vec![0.0; count(objects)];
    };
    let of = |n: usize| unit(objects.of(n)).map_or(0.0, |own| cosine(&own, &meant));
    (0..count(objects)).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_and_the_largest_vectors_have_a_direction() {
        for size in [1e-45, 1e-23, 1.0, f32::MAX] {
            assert_eq!(unit(&[0.0, -size]), Some(vec![0.0, -1.0]), "{size}");
        }
        assert_eq!(unit(&[0.0, 0.0]), None);
        assert_eq!(unit(&[f32::INFINITY]), None);
    }

    const DIM: usize = 512;
    const OBJECTS: usize = 20;

    /// Values that look like those of a normal distribution, the same in every run.
    fn normal(seed: u64) -> Vec<f32> {
        let uniform = |n: u64| {
            let mut x = (seed << 20 | n)
                .wrapping_add(1)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15);
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((x ^ (x >> 31)) >> 11) as f32 / (1u64 << 53) as f32
        };
        let value = |k: u64| (0..12).map(|j| uniform(12 * k + j)).sum::<f32>() - 6.0;
        unit(&(0..DIM as u64).map(value).collect::<Vec<_>>()).expect("a direction")
    }

    /// Words of twenty objects, ten absent ones and the negatives; objects whose vectors have this cosine with their word's.
    fn made_up(kept: f32, seed: u64) -> (Words, Vectors) {
        let mut words = Words {
            dim: DIM,
            ..Words::default()
        };
        for n in 0..OBJECTS + 10 {
            words
                .vector
                .insert(format!("word {n}"), normal(seed + n as u64));
        }
        for (n, word) in NEGATIVES.iter().enumerate() {
            words
                .vector
                .insert((*word).to_owned(), normal(seed + 100 + n as u64));
        }
        let mut value = Vec::new();
        for n in 0..OBJECTS {
            let own = normal(seed + n as u64);
            let noise = normal(seed + 200 + n as u64);
            let along = cosine(&own, &noise);
            let aside = noise.iter().zip(&own).map(|(x, o)| x - along * o);
            let aside = unit(&aside.collect::<Vec<_>>()).expect("a direction");
            let rest = (1.0 - kept * kept).sqrt();
            value.extend(own.iter().zip(&aside).map(|(o, a)| kept * o + rest * a));
        }
        (words, Vectors { dim: DIM, value })
    }

    /// Over ten sets: the share of words whose object has the highest relevancy of all and is meant; of objects that an absent word
    /// means; of absent words that mean any object. What is meant has relevancy and contrast above these.
    fn outcome(kept: f32, threshold: f32, contrast: f32) -> [f32; 3] {
        let mut sums = [0.0; 3];
        for set in 0..10 {
            let (words, objects) = made_up(kept, 1000 * set + 1);
            let scores = |n: usize| {
                let query = format!("word {n}");
                let scores = words.relevancy(&objects, &query, &NEGATIVES);
                let apart = words.contrast(&objects, &query).expect("enough objects");
                let meant = move |n: usize, score: f32| score > threshold && apart[n] > contrast;
                (scores.expect("words"), meant)
            };
            for n in 0..OBJECTS {
                let (found, is_meant) = scores(n);
                let best = (0..OBJECTS).max_by(|&a, &b| found[a].total_cmp(&found[b]));
                let is_right = best == Some(n) && is_meant(n, found[n]);
                sums[0] += if is_right { 1.0 } else { 0.0 } / (10 * OBJECTS) as f32;
            }
            for n in OBJECTS..OBJECTS + 10 {
                let (found, is_meant) = scores(n);
                let meant = (0..OBJECTS).filter(|n| is_meant(*n, found[*n])).count();
                sums[1] += meant as f32 / (100 * OBJECTS) as f32;
                sums[2] += f32::from(u8::from(meant > 0)) / 100.0;
            }
        }
        sums
    }

    #[test]
    fn words_mean_their_objects_under_noise() {
        println!("cosine  threshold  contrast  right  absent: objects, words");
        for kept in [1.0, 0.7, 0.5, 0.4, 0.3, 0.2, 0.1] {
            for (threshold, contrast) in [(0.5, 0.0), (0.8, 0.0), (THRESHOLD, CONTRAST)] {
                let [right, objects, absent] = outcome(kept, threshold, contrast);
                println!(
                    "{kept:.2}  {threshold}  {contrast}  {right:.3}  {objects:.3}  {absent:.3}"
                );
            }
        }
        // The bar: noise to a cosine of 0.5, all right, nothing for absent words, with what is the default.
        for kept in [0.7, 0.5] {
            let [right, objects, absent] = outcome(kept, THRESHOLD, CONTRAST);
            assert_eq!((right > 0.9999, objects, absent), (true, 0.0, 0.0));
        }
    }

    #[test]
    fn contrast_is_over_what_is_usual() {
        let words = Words {
            dim: 2,
            vector: BTreeMap::from([("vase".to_owned(), vec![1.0, 0.0])]),
        };
        // Cosines 0, 0.1, 0.2, 0.3, 0.8; one without a vector.
        let vector = |c: f32| [c, (1.0 - c * c).sqrt()];
        let mut value: Vec<f32> = [0.0, 0.1, 0.2, 0.3, 0.8]
            .into_iter()
            .flat_map(vector)
            .collect();
        value.extend([0.0; 2]);
        let found = words.contrast(
            &Vectors {
                dim: 2,
                value: value.clone(),
            },
            "vase",
        );
        let found = found.expect("five objects");
        // The median is 0.2, and so far from it are, in the middle, 0.1.
        assert!((found[4] - 0.6 / 0.14826).abs() < 1e-4, "{found:?}");
        assert_eq!(found[5], f32::NEG_INFINITY);
        value.truncate(8);
        assert_eq!(words.contrast(&Vectors { dim: 2, value }, "vase"), None);
    }

    #[test]
    fn the_softmax_of_a_list_finds_the_object_too() {
        let (words, objects) = made_up(0.5, 1);
        let names: Vec<String> = (0..OBJECTS).map(|n| format!("word {n}")).collect();
        for (n, name) in names.iter().enumerate() {
            let list: Vec<&str> = names
                .iter()
                .filter(|o| *o != name)
                .map(String::as_str)
                .collect();
            let found = words.softmax(&objects, name, &list).expect("words");
            let above: Vec<usize> = (0..OBJECTS).filter(|o| found[*o] > 0.6).collect();
            assert_eq!(above, [n]);
        }
        assert!(words.softmax(&objects, "no word", &[]).is_none());
    }

    #[test]
    fn objects_have_the_mean_of_the_masks_that_cover_them() {
        let labels = Labels {
            object: vec![0, 0, 1, -1],
            confidence: vec![1.0; 4],
        };
        let said = |gaussian, mask, weight| Evidence {
            gaussian,
            mask,
            weight,
        };
        let vectors = Vectors {
            dim: 2,
            value: vec![1.0, 0.0, 0.0, 1.0],
        };
        let mut means = Means::new(3);
        let view = [
            said(0, 0, 3.0),
            said(1, 1, 4.0),
            said(2, 1, 1.0),
            said(3, 0, 9.0),
            said(2, -1, 9.0),
        ];
        means.add(&view, &labels, &vectors).expect("as long");
        let longer = Vectors {
            dim: 3,
            value: vec![0.0; 6],
        };
        assert!(
            means
                .add(&view, &labels, &longer)
                .expect_err("refused")
                .contains("expected 2")
        );
        assert_eq!(means.finish().value, [0.6, 0.8, 0.0, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn an_example_finds_itself_first() {
        let (_, objects) = made_up(0.9, 3);
        let found = alike(&objects, 4);
        assert!((found[4] - 1.0).abs() < 1e-5, "{}", found[4]);
        assert!((0..OBJECTS).all(|n| n == 4 || found[n] < 0.3));
    }

    #[test]
    fn files_of_words_are_read_or_refused_in_a_sentence() {
        let file = |values: [f32; 2], kind, shape: Vec<usize>| {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            let tensor = TensorView::new(kind, shape, &bytes).expect("fits");
            safetensors::serialize([("vase", tensor)], None).expect("bytes")
        };
        let words = Words::parse(&file([3.0, 4.0], Dtype::F32, vec![2])).expect("words");
        assert_eq!(words.vector["vase"], [0.6, 0.8]);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("words.safetensors");
        words.write(&path).expect("written");
        assert_eq!(Words::read(&path).expect("readable"), words);
        let refused = |bytes: &[u8]| Words::parse(bytes).expect_err("refused");
        assert!(refused(&file([0.0; 2], Dtype::F32, vec![2])).contains("no length"));
        assert!(refused(&file([1.0; 2], Dtype::F32, vec![1, 2])).contains("expected F32 [d]"));
        assert!(refused(&file([f32::NAN; 2], Dtype::F32, vec![2])).contains("finite"));
        assert!(refused(b"pickle").contains("safetensors"));
    }
}

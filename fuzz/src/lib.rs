//! Fuzz targets: everything of cosplat that reads what somebody else wrote, each as a function of bytes.
//!
//! A target panics where its input did harm: a panic of the reader, a number that is not finite in what it accepted, or
//! more memory than [`Target::run`] allows. `fuzz/run` searches for such inputs by coverage; `tests/mutations.rs` tries
//! seeded mutations in every `cargo test`.

pub mod mutate;
pub mod targets;

pub use targets::{TARGETS, Target};

/// Memory that a run may hold at once beside what its input accounts for [bytes].
const MEMORY: u64 = 64 << 20;
/// Memory that a run may hold per byte of its input [bytes].
const MEMORY_PER_BYTE: u64 = 1 << 10;

impl Target {
    /// A target of binary inputs without seeds.
    pub fn new(name: &'static str, read: fn(&[u8])) -> Self {
        Self {
            name,
            shape: targets::Shape::Binary,
            read,
            seeds: Vec::new,
        }
    }

    /// The target of a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        TARGETS.iter().find(|target| target.name == name)
    }

    /// Gives an input to the reader.
    ///
    /// # Panics
    /// When it did harm.
    pub fn run(&self, data: &[u8]) {
        let held = allocation_counter::measure(|| (self.read)(data)).bytes_max;
        let allowed = MEMORY + MEMORY_PER_BYTE * data.len() as u64;
        assert!(
            held <= allowed,
            "{} bytes of input made {} hold {held} bytes, expected at most {allowed}",
            data.len(),
            self.name
        );
    }
}

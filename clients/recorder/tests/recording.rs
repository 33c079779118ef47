//! Stories about recordings: written, read back, cut off, damaged, repaired, read by others.

mod recording {
    pub mod damage;
    pub mod elsewhere;
    pub mod killed;
    pub mod live;
    pub mod read_back;
    pub mod synthetic;
}

//! Objects from masks on scenes whose labels are known: masks with names, masks whose numbers mean nothing, and no masks at all.

mod alone;
mod captures;
mod named;
mod scenes;
mod unnamed;

//! Two ends of the wire, in threads and processes of their own.

mod wire {
    mod attach;
    mod commands;
    mod support;
}

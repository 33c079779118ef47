//! Two ends of the wire, in threads and processes of their own.

mod wire {
    mod attach;
    mod changes;
    mod child;
    mod commands;
    mod crash;
    mod examples;
    mod header;
    mod impostors;
    mod limits;
    mod refusals;
    mod shm;
    mod steps;
    mod support;
    mod users;
}

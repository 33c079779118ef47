//! Barrier, time-outs and policies, on a clock of the tests.

use cosplat_ipc::schema::padded;

use super::*;

const SECOND: Duration = Duration::from_secs(1);

/// A session without transport: ports 1, 2, ... and tickets as they come.
struct Table {
    lockstep: Lockstep,
    clock: Instant,
    ports: BTreeSet<u128>,
    waiting: BTreeSet<u64>,
    step: u64,
    next_ticket: u64,
}

impl Table {
    fn new(required: &[&str], timeout: Option<Duration>, policy: Policy) -> Table {
        let terms = Terms { timeout, policy };
        let options = LockstepOptions {
            required: required
                .iter()
                .map(|name| (name.to_string(), None))
                .collect(),
            terms,
        };
        let clock = Instant::now();
        Table {
            lockstep: Lockstep::new(&options, clock),
            clock,
            ports: BTreeSet::new(),
            waiting: BTreeSet::new(),
            step: 0,
            next_ticket: 1,
        }
    }

    fn now(&self) -> Now {
        Now {
            step: self.step,
            ..Now::default()
        }
    }

    /// What is said to a request at once; `Err` with the reason of a refusal.
    fn send(
        &mut self,
        port: u128,
        name: &str,
        change: impl Fn(&mut StepRequest),
    ) -> Result<Option<u64>, String> {
        self.ports.insert(port);
        let mut header = StepRequest {
            participant: padded(name),
            ..StepRequest::default()
        };
        change(&mut header);
        let ticket = self.next_ticket;
        self.next_ticket += 1;
        let now = self.now();
        match self.lockstep.hear(ticket, port, &header, now, Vec::new) {
            None => {
                self.waiting.insert(ticket);
                Ok(Some(ticket))
            }
            Some((done, _)) if done.cause == wire::RETURN_REFUSED => {
                Err(done.reason().expect("text").to_owned())
            }
            Some(_) => Ok(None),
        }
    }

    fn attach(&mut self, port: u128, name: &str) -> Result<Option<u64>, String> {
        self.send(port, name, |header| header.kind = wire::STEP_ATTACH)
    }

    fn ask(&mut self, port: u128, name: &str, frames: u32) -> u64 {
        let asked = self.send(port, name, |header| {
            header.kind = wire::STEP_ADVANCE;
            header.frames = frames;
        });
        asked.expect("heard").expect("a ticket")
    }

    /// Makes a step; tickets that are answered, with their causes.
    fn step(&mut self) -> Vec<(u64, u32)> {
        assert!(self.lockstep.permits());
        self.step += 1;
        let now = self.now();
        let answers = self.lockstep.stepped(&StepOutcome::default(), SECOND, now);
        self.answered(answers)
    }

    fn pass(&mut self, time: Duration, paused: bool) -> Vec<(u64, u32)> {
        self.clock += time;
        let now = self.now();
        let waiting = self.waiting.clone();
        let waits = |ticket: u64| waiting.contains(&ticket);
        let answers = self
            .lockstep
            .tick(self.clock, paused, &self.ports, waits, now);
        self.answered(answers)
    }

    fn answered(&mut self, answers: Vec<Answer>) -> Vec<(u64, u32)> {
        let of = |(ticket, (done, _)): Answer| (ticket, done.cause);
        let answers: Vec<_> = answers.into_iter().map(of).collect();
        for (ticket, _) in &answers {
            self.waiting.remove(ticket);
        }
        answers
    }
}

#[test]
fn every_step_needs_the_permission_of_all() {
    let mut table = Table::new(&[], None, Policy::Wait);
    assert!(table.lockstep.freewheels() && table.lockstep.permits());
    for (port, name) in [(1, "arm"), (2, "camera"), (3, "planner")] {
        assert_eq!(table.attach(port, name), Ok(None));
        assert!(!table.lockstep.permits() && !table.lockstep.freewheels());
    }
    let arm = table.ask(1, "arm", 3);
    let camera = table.ask(2, "camera", 1);
    assert!(!table.lockstep.permits());
    let planner = table.ask(3, "planner", 2);
    // Each is answered after as many steps as it asked for, and waited for again.
    assert_eq!(table.step(), [(camera, wire::RETURN_COMPLETE)]);
    assert!(!table.lockstep.permits());
    let camera = table.ask(2, "camera", 2);
    assert_eq!(table.step(), [(planner, wire::RETURN_COMPLETE)]);
    table.ask(3, "planner", 9);
    let answers = table.step();
    assert_eq!(
        answers,
        [
            (arm, wire::RETURN_COMPLETE),
            (camera, wire::RETURN_COMPLETE)
        ]
    );
}

#[test]
fn those_who_are_named_are_waited_for_from_the_start() {
    let mut table = Table::new(&["arm", "camera"], None, Policy::Wait);
    assert!(!table.lockstep.freewheels() && !table.lockstep.permits());
    table.attach(1, "arm").expect("taken in");
    table.ask(1, "arm", 1);
    assert!(!table.lockstep.permits());
    table.attach(2, "camera").expect("taken in");
    table.ask(2, "camera", 1);
    assert_eq!(table.step().len(), 2);
    let left = table.send(2, "camera", |header| header.kind = wire::STEP_DETACH);
    assert_eq!(left, Ok(None));
    table.ask(1, "arm", 1);
    assert!(table.lockstep.permits(), "who has left is not waited for");
}

#[test]
fn what_breaks_a_rule_is_refused_with_a_reason() {
    let mut table = Table::new(&[], None, Policy::Wait);
    let advance = |frames| {
        move |header: &mut StepRequest| {
            header.kind = wire::STEP_ADVANCE;
            header.frames = frames;
        }
    };
    let mut refused = |port, name: &str, change: &dyn Fn(&mut StepRequest)| {
        table.send(port, name, change).expect_err("refused")
    };
    let attach = |header: &mut StepRequest| header.kind = wire::STEP_ATTACH;
    assert!(refused(1, "arm", &advance(1)).contains("not attached"));
    assert!(refused(1, "", &attach).contains("no participant"));
    assert!(refused(1, "a b", &attach).contains("no participant"));
    assert!(refused(1, "arm", &|header| header.kind = 9).contains("9 is unknown"));
    table.attach(1, "arm").expect("taken in");
    let mut refused = |port, name: &str, change: &dyn Fn(&mut StepRequest)| {
        table.send(port, name, change).expect_err("refused")
    };
    assert!(refused(2, "arm", &attach).contains("attached already"));
    assert!(refused(1, "leg", &attach).contains("as arm already"));
    assert!(refused(1, "arm", &advance(0)).contains("0 steps"));
    assert!(refused(1, "arm", &advance(wire::MAX_STEPS + 1)).contains("1000001 steps"));
    let until = |header: &mut StepRequest| {
        advance(1)(header);
        header.until = 8;
    };
    assert!(refused(1, "arm", &until).contains("until is 8"));
    let kind = |header: &mut StepRequest| {
        advance(1)(header);
        header.pair_kind = 3;
    };
    assert!(refused(1, "arm", &kind).contains("pair_kind is 3"));
    let full = |header: &mut StepRequest| {
        attach(header);
        header.frames = 1;
    };
    assert!(refused(3, "leg", &full).contains("expected none"));
    table.ask(1, "arm", 1);
    let again = table.send(1, "arm", advance(1)).expect_err("refused");
    assert!(again.contains("one request at a time"), "{again}");
}

#[test]
fn a_late_participant_is_treated_by_the_policy() {
    for policy in [Policy::Wait, Policy::Drop, Policy::Stop] {
        let mut table = Table::new(&["camera"], Some(SECOND), policy);
        table.attach(1, "arm").expect("taken in");
        table.ask(1, "arm", 5);
        table.pass(SECOND / 2, false);
        // A pause holds the clock.
        table.pass(10 * SECOND, true);
        assert!(!table.lockstep.permits() && !table.lockstep.is_stopped());
        table.pass(SECOND, false);
        assert_eq!(table.lockstep.permits(), policy == Policy::Drop);
        assert_eq!(table.lockstep.is_stopped(), policy == Policy::Stop);
        if policy == Policy::Drop {
            let late = table.send(2, "camera", |header| {
                header.kind = wire::STEP_ADVANCE;
                header.frames = 1;
            });
            assert!(late.expect_err("dropped").contains("dropped"));
            table.attach(2, "camera").expect("it may come back");
            assert!(!table.lockstep.permits());
        }
    }
}

#[test]
fn a_dead_participant_is_treated_by_the_policy_at_once() {
    for policy in [Policy::Wait, Policy::Drop, Policy::Stop] {
        let mut table = Table::new(&[], None, policy);
        table.attach(1, "arm").expect("taken in");
        table.attach(2, "camera").expect("taken in");
        table.ask(1, "arm", 5);
        table.ask(2, "camera", 5);
        table.ports.remove(&2);
        table.pass(Duration::ZERO, false);
        assert_eq!(table.lockstep.permits(), policy == Policy::Drop);
        assert_eq!(table.lockstep.is_stopped(), policy == Policy::Stop);
        if policy == Policy::Wait {
            table
                .attach(3, "camera")
                .expect("it comes back by another port");
            table.ask(3, "camera", 1);
            assert!(table.lockstep.permits());
        }
    }
}

#[test]
fn who_gives_up_waiting_permits_nothing() {
    let mut table = Table::new(&[], None, Policy::Wait);
    table.attach(1, "arm").expect("taken in");
    table.attach(2, "camera").expect("taken in");
    table.ask(2, "camera", 1);
    let arm = table.ask(1, "arm", 1);
    table.waiting.remove(&arm);
    table.pass(Duration::ZERO, false);
    assert!(!table.lockstep.permits());
    table.ask(1, "arm", 1);
    assert_eq!(table.step().len(), 2);
}

#[test]
fn a_request_may_have_a_time_of_its_own() {
    let mut table = Table::new(&[], None, Policy::Wait);
    table.attach(1, "arm").expect("taken in");
    table.attach(2, "camera").expect("taken in");
    let asked = table.send(1, "arm", |header| {
        header.kind = wire::STEP_ADVANCE;
        header.frames = 5;
        header.timeout_ns = 500_000_000;
    });
    let arm = asked.expect("heard").expect("a ticket");
    assert_eq!(table.pass(SECOND / 4, false), []);
    assert_eq!(table.pass(SECOND / 4, false), [(arm, wire::RETURN_TIMEOUT)]);
    table.ask(2, "camera", 1);
    assert!(!table.lockstep.permits(), "what it permitted is withdrawn");
}

#[test]
fn an_answer_counts_its_steps_and_their_time() {
    let mut table = Table::new(&[], None, Policy::Wait);
    table.attach(1, "arm").expect("taken in");
    let ticket = table.ask(1, "arm", 5);
    table.step();
    table.step();
    let outcome = StepOutcome {
        quarantined: 1,
        ..StepOutcome::default()
    };
    table.step += 1;
    let now = table.now();
    assert_eq!(
        table.lockstep.stepped(&outcome, SECOND, now),
        [],
        "it did not ask for that"
    );
    let answers = table.lockstep.give_up(now);
    let (answered, (done, _)) = &answers[0];
    assert_eq!((*answered, done.cause), (ticket, wire::RETURN_TERMINATE));
    assert_eq!(
        (done.frames, done.step, done.step_ns),
        (3, 3, 3_000_000_000)
    );
}

#[test]
fn a_session_stands_when_its_last_named_participant_has_left() {
    let leave = |header: &mut StepRequest| header.kind = wire::STEP_DETACH;
    for (named, stands) in [(&["arm"][..], true), (&[], false)] {
        let mut table = Table::new(named, None, Policy::Wait);
        table.attach(1, "arm").expect("taken in");
        table.ask(1, "arm", 1);
        table.step();
        table.send(1, "arm", leave).expect("it may");
        assert_eq!(table.lockstep.permits(), !stands);
        assert_eq!(table.lockstep.freewheels(), !stands);
        // Another one makes it go on, and stand again.
        table.attach(2, "leg").expect("taken in");
        table.ask(2, "leg", 1);
        table.step();
        table.send(2, "leg", leave).expect("it may");
        assert_eq!(table.lockstep.freewheels(), !stands);
    }
    // Who is dropped is gone on without, as the policy says.
    let mut table = Table::new(&["arm"], Some(SECOND), Policy::Drop);
    table.pass(2 * SECOND, false);
    assert!(table.lockstep.freewheels());
}

#[test]
fn what_came_with_a_request_that_ends_early_is_called_off() {
    let mut table = Table::new(&[], None, Policy::Wait);
    for (port, name) in [(1, "arm"), (2, "leg"), (3, "eye"), (4, "ear")] {
        table.attach(port, name).expect("taken in");
    }
    let quarantine = |header: &mut StepRequest| {
        header.kind = wire::STEP_ADVANCE;
        header.frames = 5;
        header.until = wire::UNTIL_QUARANTINE;
    };
    let arm = table.send(1, "arm", quarantine);
    let arm = arm.expect("heard").expect("a ticket");
    let timeout = |header: &mut StepRequest| {
        header.kind = wire::STEP_ADVANCE;
        header.frames = 5;
        header.timeout_ns = 1;
    };
    let leg = table.send(2, "leg", timeout);
    let leg = leg.expect("heard").expect("a ticket");
    let eye = table.ask(3, "eye", 1);
    let ear = table.ask(4, "ear", 9);
    let outcome = StepOutcome {
        quarantined: 1,
        ..StepOutcome::default()
    };
    let now = table.now();
    let answers = table.lockstep.stepped(&outcome, SECOND, now);
    let answered: Vec<_> = answers.iter().map(|(ticket, _)| *ticket).collect();
    assert_eq!(answered, [arm, eye]);
    let request = |port, ticket| CalledOff::Request { port, ticket };
    // The eye has had all its steps.
    assert_eq!(table.lockstep.called_off(), [request(1, arm)]);
    assert_eq!(table.pass(SECOND, false), [(leg, wire::RETURN_TIMEOUT)]);
    assert_eq!(table.lockstep.called_off(), [request(2, leg)]);
    table.waiting.remove(&ear);
    table.pass(SECOND, false);
    assert_eq!(table.lockstep.called_off(), [request(4, ear)]);
    table
        .send(2, "leg", |header| header.kind = wire::STEP_DETACH)
        .expect("it may");
    table.ports.remove(&3);
    table.pass(SECOND, false);
    let gone = [CalledOff::Port(2), CalledOff::Port(3)];
    assert_eq!(table.lockstep.called_off(), gone);
}

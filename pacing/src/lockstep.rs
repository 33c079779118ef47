//! Lock-step: who takes part, what each of them permits, and what becomes of those who keep the others waiting.

use std::{
    collections::{BTreeMap, BTreeSet},
    time::{Duration, Instant},
};

use cosplat_ipc::{
    client::check_participant,
    schema::{self as wire, Ack, StepDone, StepRequest},
};

use crate::outcome::{Finding, StepOutcome};

/// What is done about a participant that is waited for too long, or whose process died.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// Go on waiting, until it comes back under its name.
    #[default]
    Wait,
    /// Go on without it.
    Drop,
    /// End the session.
    Stop,
}

/// How long a participant is waited for, and what then.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Terms {
    /// Wall time for each of its answers; none for ever.
    pub timeout: Option<Duration>,
    /// What is done then.
    pub policy: Policy,
}

/// Who takes part.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LockstepOptions {
    /// Names that are waited for from the first step on, with terms of their own where they have some.
    pub required: Vec<(String, Option<Terms>)>,
    /// Terms of all others.
    pub terms: Terms,
}

/// An answer to a participant, and the ticket it goes by.
pub type Answer = (u64, (StepDone, Vec<Ack>));

/// A request that waits for its steps.
#[derive(Debug)]
struct Asked {
    ticket: u64,
    header: StepRequest,
    acks: Vec<Ack>,
    /// Steps made for it.
    made: u32,
    /// Time that they took.
    spent: Duration,
    /// When its own time is over, paused or not.
    until: Option<Instant>,
}

#[derive(Debug)]
struct Member {
    name: String,
    terms: Terms,
    /// Its port; none while it is not attached.
    port: Option<u128>,
    asked: Option<Asked>,
    /// Time of the clock since when it is waited for.
    since: Duration,
    /// Whether the log has heard that it is late.
    is_late: bool,
}

/// The last state that was published.
#[derive(Clone, Copy, Debug, Default)]
pub struct Now {
    /// Its step.
    pub step: u64,
    /// Simulated time [s].
    pub sim_time: f64,
    /// Hash of the state.
    pub state_hash: u64,
}

/// Orders that are not carried out any more, unless they have been.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CalledOff {
    /// Those that came with a request whose last step is not made.
    Request {
        /// The port it came by.
        port: u128,
        /// Its ticket.
        ticket: u64,
    },
    /// All of a participant that takes part no more.
    Port(u128),
}

/// What takes part at present.
#[derive(Debug)]
pub struct Lockstep {
    members: Vec<Member>,
    /// Who was dropped, and why.
    dropped: BTreeMap<String, String>,
    terms: Terms,
    /// Runs while the server is not paused: nobody is called late in a pause.
    clock: Duration,
    /// When it was looked at last.
    ticked: Instant,
    /// Why the session ends, if it does.
    stopped: Option<String>,
    /// Whether participants were named: a session that somebody has to step does not run by itself.
    is_listed: bool,
    /// Whether the last of the named ones, and of all who joined them, has left.
    stands: bool,
    /// What is to be called off.
    called_off: Vec<CalledOff>,
}

impl Lockstep {
    /// Nobody has attached yet.
    pub fn new(options: &LockstepOptions, now: Instant) -> Lockstep {
        let member = |(name, terms): &(String, Option<Terms>)| Member {
            name: name.clone(),
            terms: terms.unwrap_or(options.terms),
            port: None,
            asked: None,
            since: Duration::ZERO,
            is_late: false,
        };
        Lockstep {
            members: options.required.iter().map(member).collect(),
            dropped: BTreeMap::new(),
            terms: options.terms,
            clock: Duration::ZERO,
            ticked: now,
            stopped: None,
            is_listed: !options.required.is_empty(),
            stands: false,
            called_off: Vec::new(),
        }
    }

    /// Whether nobody takes part: the server goes on by itself.
    pub fn freewheels(&self) -> bool {
        self.members.is_empty() && !self.stands
    }

    /// Whether all permit a step.
    pub fn permits(&self) -> bool {
        !self.stands && self.members.iter().all(|member| member.asked.is_some())
    }

    /// What was called off since the last look.
    pub fn called_off(&mut self) -> Vec<CalledOff> {
        std::mem::take(&mut self.called_off)
    }

    /// Whether a participant's policy ends the session.
    pub fn is_stopped(&self) -> bool {
        self.stopped.is_some()
    }

    /// Whether a participant waits for a contact.
    pub fn awaits_contact(&self) -> bool {
        let asked = self.members.iter().filter_map(|m| m.asked.as_ref());
        asked
            .map(|asked| asked.header.until)
            .any(|until| until & wire::UNTIL_CONTACT != 0)
    }

    /// Looks at a request that came by `port`; `commands` judges and takes in those that go with it, once it is clear
    /// that the request is heard. None when the answer comes later.
    pub fn hear(
        &mut self,
        ticket: u64,
        port: u128,
        header: &StepRequest,
        now: Now,
        commands: impl FnOnce() -> Vec<Ack>,
    ) -> Option<(StepDone, Vec<Ack>)> {
        match self.heed(ticket, port, header, commands) {
            Ok(true) => None,
            Ok(false) => Some((now.done(wire::RETURN_COMPLETE, ""), vec![])),
            Err(reason) => Some(refusal(&reason, now)),
        }
    }

    /// Whether the answer comes later, or why the request is refused.
    fn heed(
        &mut self,
        ticket: u64,
        port: u128,
        header: &StepRequest,
        commands: impl FnOnce() -> Vec<Ack>,
    ) -> Result<bool, String> {
        let name = header.participant().map_err(|error| error.to_string())?;
        check_participant(name).map_err(|error| error.to_string())?;
        if header.kind != wire::STEP_ADVANCE && (header.count != 0 || header.frames != 0) {
            return Err(format!(
                "{} commands and {} steps come with a request to attach or detach, expected none",
                header.count, header.frames
            ));
        }
        match header.kind {
            wire::STEP_ATTACH => self.attach(name, port).map(|()| false),
            wire::STEP_DETACH => self.own(name, port).map(|at| {
                tracing::info!("participant {name} has left");
                self.members.remove(at);
                self.called_off.push(CalledOff::Port(port));
                self.stands = self.is_listed && self.members.is_empty();
                if self.stands {
                    tracing::warn!(
                        "nobody takes part any more: the server waits until somebody does"
                    );
                }
                false
            }),
            wire::STEP_ADVANCE => {
                check_advance(header)?;
                let at = self.own(name, port)?;
                if self.members[at].asked.is_some() {
                    return Err("it has asked for steps that are not made yet, expected one request at a time".into());
                }
                let until = self.ticked + Duration::from_nanos(header.timeout_ns);
                self.members[at].asked = Some(Asked {
                    ticket,
                    header: *header,
                    acks: commands(),
                    made: 0,
                    spent: Duration::ZERO,
                    until: (header.timeout_ns > 0).then_some(until),
                });
                self.members[at].is_late = false;
                Ok(true)
            }
            kind => Err(format!(
                "kind of request {kind} is unknown: expected 1 to 3"
            )),
        }
    }

    fn attach(&mut self, name: &str, port: u128) -> Result<(), String> {
        let clock = self.clock;
        if let Some(other) = self.members.iter().find(|m| m.port == Some(port)) {
            return Err(format!("this port takes part as {} already", other.name));
        }
        match self.members.iter_mut().find(|m| m.name == name) {
            Some(member) if member.port.is_some() => {
                return Err("a participant of this name is attached already".into());
            }
            Some(member) => {
                member.port = Some(port);
                member.since = clock;
                member.is_late = false;
            }
            None => self.members.push(Member {
                name: name.into(),
                terms: self.terms,
                port: Some(port),
                asked: None,
                since: clock,
                is_late: false,
            }),
        }
        self.dropped.remove(name);
        self.stands = false;
        tracing::info!("participant {name} takes part");
        Ok(())
    }

    /// The member of this name that has this port.
    fn own(&self, name: &str, port: u128) -> Result<usize, String> {
        let is_it = |m: &Member| m.name == name && m.port == Some(port);
        self.members
            .iter()
            .position(is_it)
            .ok_or_else(|| match self.dropped.get(name) {
                Some(why) => format!("it was dropped: {why}; it may attach again"),
                None => "it is not attached: expected a request to attach first".into(),
            })
    }

    /// Lets time pass, unless the server is `paused`; `ports` are those that are attached, and `waits` says whether the
    /// sender of a ticket still waits. Deals with those who are gone or late, and returns what is to be answered.
    pub fn tick(
        &mut self,
        now: Instant,
        paused: bool,
        ports: &BTreeSet<u128>,
        waits: impl Fn(u64) -> bool,
        at: Now,
    ) -> Vec<Answer> {
        if !paused {
            self.clock += now.saturating_duration_since(self.ticked);
        }
        self.ticked = now;
        let mut fates = Vec::new();
        let (clock, mut n) = (self.clock, 0);
        while n < self.members.len() {
            let member = &mut self.members[n];
            if let Some(asked) = member.asked.take_if(|asked| !waits(asked.ticket)) {
                // It gave up waiting: what it permitted is withdrawn.
                member.since = clock;
                self.called_off.extend(member.call_off(&asked));
            }
            let is_gone = member.port.is_some_and(|port| !ports.contains(&port));
            if is_gone {
                self.called_off
                    .extend(member.port.take().map(CalledOff::Port));
                member.asked = None;
                member.since = clock;
            }
            let waited = clock.saturating_sub(member.since);
            let is_late = member.asked.is_none()
                && member
                    .terms
                    .timeout
                    .is_some_and(|timeout| waited >= timeout);
            if (is_gone || is_late) && !member.is_late {
                member.is_late = true;
                let seconds = waited.as_secs_f64();
                let why = match (is_gone, member.port) {
                    (true, _) => format!("participant {} is gone without leaving", member.name),
                    (_, None) => format!(
                        "participant {} has not come for {seconds:.1} s",
                        member.name
                    ),
                    _ => format!(
                        "participant {} has asked for no step for {seconds:.1} s",
                        member.name
                    ),
                };
                fates.push((member.name.clone(), member.terms.policy, why));
            }
            n += 1;
        }
        for (name, policy, why) in fates {
            self.deal_with(name, policy, why, at.step);
        }
        self.own_timeouts(at)
    }

    fn deal_with(&mut self, name: String, policy: Policy, why: String, step: u64) {
        match policy {
            Policy::Wait => tracing::warn!("{why}: the server waits for it at step {step}"),
            Policy::Drop => {
                tracing::warn!("{why}: the server goes on without it from step {step}");
                let (out, stay) = std::mem::take(&mut self.members)
                    .into_iter()
                    .partition::<Vec<_>, _>(|member| member.name == name);
                self.members = stay;
                let ports = out.iter().filter_map(|member| member.port);
                self.called_off.extend(ports.map(CalledOff::Port));
                self.dropped.insert(name, format!("{why}, at step {step}"));
            }
            Policy::Stop => {
                tracing::warn!("{why}: the session ends at step {step}");
                self.stopped.get_or_insert(why);
            }
        }
    }

    /// Answers requests whose own time is over.
    fn own_timeouts(&mut self, at: Now) -> Vec<Answer> {
        let (clock, now) = (self.clock, self.ticked);
        let is_over = |asked: &Asked| asked.until.is_some_and(|until| now >= until);
        if !self
            .members
            .iter()
            .filter_map(|m| m.asked.as_ref())
            .any(is_over)
        {
            return vec![];
        }
        let missing = self.members.iter().filter(|member| member.asked.is_none());
        let missing: Vec<&str> = missing.map(|member| member.name.as_str()).collect();
        let reason = match missing.is_empty() {
            true => "the steps took longer".to_owned(),
            false => format!("waited for {}", missing.join(", ")),
        };
        let mut answers = Vec::new();
        for member in &mut self.members {
            if let Some(asked) = member.asked.take_if(|asked| is_over(asked)) {
                member.since = clock;
                self.called_off.extend(member.call_off(&asked));
                answers.push(asked.answer(at.done(wire::RETURN_TIMEOUT, &reason)));
            }
        }
        answers
    }

    /// A step was made in `spent`, and its frame sent. Returns what is to be answered.
    pub fn stepped(&mut self, outcome: &StepOutcome<'_>, spent: Duration, at: Now) -> Vec<Answer> {
        let clock = self.clock;
        let mut answers = Vec::new();
        for member in &mut self.members {
            let Some(asked) = &mut member.asked else {
                continue;
            };
            asked.made += 1;
            asked.spent += spent;
            let done = match outcome.finding(&asked.header) {
                Some(finding) => at.found(&finding),
                None if asked.made >= asked.header.frames => at.done(wire::RETURN_COMPLETE, ""),
                None => continue,
            };
            member.since = clock;
            if let Some(asked) = member.asked.take() {
                if done.cause != wire::RETURN_COMPLETE {
                    self.called_off.extend(member.call_off(&asked));
                }
                answers.push(asked.answer(done));
            }
        }
        answers
    }

    /// The server ends: nothing that was asked for follows.
    pub fn give_up(&mut self, at: Now) -> Vec<Answer> {
        let reason = match &self.stopped {
            Some(why) => format!("the session ends: {why}"),
            None => "the server ends".to_owned(),
        };
        let asked = self.members.iter_mut().filter_map(|m| m.asked.take());
        asked
            .map(|asked| asked.answer(at.done(wire::RETURN_TERMINATE, &reason)))
            .collect()
    }
}

impl Member {
    /// The orders of a request that is withdrawn.
    fn call_off(&self, asked: &Asked) -> Option<CalledOff> {
        let ticket = asked.ticket;
        self.port.map(|port| CalledOff::Request { port, ticket })
    }
}

impl Asked {
    fn answer(self, done: StepDone) -> Answer {
        let done = StepDone {
            frames: self.made,
            step_ns: u64::try_from(self.spent.as_nanos()).unwrap_or(u64::MAX),
            ..done
        };
        (self.ticket, (done, self.acks))
    }
}

impl Now {
    fn done(self, cause: u32, reason: &str) -> StepDone {
        StepDone {
            step: self.step,
            sim_time: self.sim_time,
            state_hash: self.state_hash,
            ..StepDone::of_cause(cause, reason)
        }
    }

    fn found(self, finding: &Finding) -> StepDone {
        StepDone {
            contact: finding.contact,
            contact_kind: finding.contact_kind,
            ..self.done(finding.cause, &finding.reason)
        }
    }
}

/// Refuses a request as a whole: its commands get no answers of their own.
pub fn refusal(reason: &str, at: Now) -> (StepDone, Vec<Ack>) {
    (at.done(wire::RETURN_REFUSED, reason), vec![])
}

fn check_advance(header: &StepRequest) -> Result<(), String> {
    let frames = header.frames;
    if !(1..=wire::MAX_STEPS).contains(&frames) {
        return Err(format!(
            "{frames} steps are asked for, expected 1 to {}",
            wire::MAX_STEPS
        ));
    }
    let known = wire::UNTIL_CONTACT | wire::UNTIL_EVENT | wire::UNTIL_QUARANTINE;
    if header.until & !known != 0 {
        return Err(format!(
            "until is {}, expected at most {known}",
            header.until
        ));
    }
    if header.pair_kind > wire::CONTACT_COLLIDER {
        let most = wire::CONTACT_COLLIDER;
        return Err(format!(
            "pair_kind is {}, expected 0 to {most}",
            header.pair_kind
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests;

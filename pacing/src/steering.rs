//! Permission to step: pauses, resumptions and the end, now or from a later step on.

use crate::waiting::{Order, Waiting};

/// An order to the server itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Stop stepping.
    Pause,
    /// Step again.
    Resume,
    /// Shut down.
    Stop,
}

/// What the server does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// The next step.
    Step,
    /// Nothing, until somebody resumes it.
    Wait,
    /// It ends.
    End,
}

/// Whether the server may step.
#[derive(Debug, Default)]
pub struct Steering {
    paused: bool,
    /// Steps that may be made although it is paused.
    single: u64,
    stopped: bool,
    later: Waiting<Control>,
}

impl Steering {
    /// Nothing ordered yet.
    pub fn new(paused: bool) -> Steering {
        Steering {
            paused,
            ..Steering::default()
        }
    }

    /// What all orders until now come to.
    pub fn permission(&self) -> Permission {
        match (self.stopped, self.paused && self.single == 0) {
            (true, _) => Permission::End,
            (false, true) => Permission::Wait,
            (false, false) => Permission::Step,
        }
    }

    /// Takes an order for `count` steps while paused; the last of them is returned.
    ///
    /// # Errors
    /// A sentence when the server is not paused, or not at that `step`.
    pub fn single_steps(&mut self, count: u64, step: u64, next_step: u64) -> Result<u64, String> {
        if !self.paused {
            return Err("the server runs, expected a paused one: pause it first".into());
        }
        if step > next_step {
            return Err(format!(
                "apply_at_step is {step}, expected at most {next_step}: a paused server makes no step by itself"
            ));
        }
        self.single += count;
        Ok(next_step + self.single - 1)
    }

    /// A step was made; the next one is `next_step`: obeys what is due before that.
    pub fn made_step(&mut self, next_step: u64) {
        self.single = self.single.saturating_sub(1);
        self.reach(next_step);
    }

    /// What waits for its step.
    pub fn later(&mut self) -> &mut Waiting<Control> {
        &mut self.later
    }

    /// The steps that a paused server was to make are not made.
    pub fn cancel_steps(&mut self) {
        self.single = 0;
    }

    /// Takes an order; `next_step` is the first step still to come.
    ///
    /// # Errors
    /// A sentence when a server that is paused would have to reach a later step to be resumed, or too many of the sender's
    /// orders wait.
    pub fn order(&mut self, order: Order, control: Control, next_step: u64) -> Result<(), String> {
        if control == Control::Resume
            && let Some(halt) = self.halts_before(order.step, next_step)
        {
            return Err(format!(
                "step {} never comes while the server is paused before step {halt}: resume it at step {halt}",
                order.step
            ));
        }
        if order.step <= next_step {
            self.obey(control);
        } else {
            self.later.has_room(order.port, "later steps")?;
            self.later.push(order, control);
        }
        Ok(())
    }

    /// The step before which the server stands still for ever, as far as it is known, and so never reaches `step`.
    fn halts_before(&self, step: u64, next_step: u64) -> Option<u64> {
        let mut halt = self.paused.then_some(next_step);
        for (order, control) in self.later.iter().take_while(|(order, _)| order.step < step) {
            if halt.is_some_and(|halt| halt < order.step) {
                break;
            }
            halt = match control {
                Control::Pause => Some(order.step),
                Control::Resume | Control::Stop => None,
            };
        }
        halt.filter(|halt| *halt < step)
    }

    /// Obeys what is due before `next_step`.
    pub fn reach(&mut self, next_step: u64) {
        for (_, control) in self.later.take_due(next_step) {
            self.obey(control);
        }
    }

    /// Suspends stepping: something happened that somebody has to look at.
    pub fn pause(&mut self) {
        self.paused = true;
        self.single = 0;
    }

    fn obey(&mut self, control: Control) {
        match control {
            Control::Pause => self.paused = true,
            Control::Resume => {
                self.paused = false;
                self.single = 0;
            }
            Control::Stop => self.stopped = true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Permission::{End, Step, Wait};

    /// Permission before each of the steps 1 to 9, with `orders` given before step 1: step, client, sequence, order.
    fn run(paused: bool, orders: &[(u64, u64, u64, Control)]) -> Vec<Permission> {
        let mut steering = Steering::new(paused);
        for &(step, client, sequence, control) in orders {
            let order = Order {
                step,
                client,
                sequence,
                ..Order::default()
            };
            steering.order(order, control, 1).expect("taken");
        }
        let before = |next_step| {
            steering.reach(next_step);
            steering.permission()
        };
        (1..=9).map(before).collect()
    }

    #[test]
    fn orders_act_at_their_step_and_not_before() {
        let permissions = run(
            false,
            &[(8, 1, 2, Control::Stop), (4, 1, 1, Control::Pause)],
        );
        assert_eq!(permissions[..3], [Step; 3]);
        assert_eq!(permissions[3..7], [Wait; 4]);
        assert_eq!(permissions[7..], [End; 2]);
        assert_eq!(run(true, &[(1, 1, 1, Control::Resume)]), [Step; 9]);
    }

    #[test]
    fn orders_of_one_step_act_by_client_and_sequence() {
        let (pause, resume) = (Control::Pause, Control::Resume);
        assert_eq!(
            run(false, &[(4, 1, 2, resume), (4, 1, 1, pause)]),
            [Step; 9]
        );
        let paused = run(false, &[(4, 2, 1, pause), (4, 1, 7, resume)]);
        assert_eq!((paused[2], paused[3]), (Step, Wait));
    }

    #[test]
    fn a_paused_server_makes_the_steps_that_are_ordered() {
        let mut steering = Steering::new(true);
        assert_eq!(steering.single_steps(2, 0, 5), Ok(6));
        assert_eq!(steering.single_steps(1, 5, 5), Ok(7));
        let late = steering
            .single_steps(1, 9, 5)
            .expect_err("step 9 never comes");
        assert!(late.contains('9') && late.contains('5'), "{late}");
        for next_step in 6..=8 {
            assert_eq!(steering.permission(), Step);
            steering.made_step(next_step);
        }
        assert_eq!(steering.permission(), Wait);
        let mut runs = Steering::new(false);
        runs.single_steps(1, 0, 5).expect_err("it is not paused");
    }

    #[test]
    fn a_resumption_that_cannot_come_is_refused() {
        let order = |steering: &mut Steering, step, control| {
            let order = Order {
                step,
                client: 1,
                sequence: step,
                ..Order::default()
            };
            steering.order(order, control, 5)
        };
        let mut paused = Steering::new(true);
        let refused = order(&mut paused, 20, Control::Resume);
        let said = refused.expect_err("step 20 never comes");
        assert!(
            said.contains("step 20") && said.contains("step 5"),
            "{said}"
        );
        // With a resumption before, it comes; with a pause between, it does not.
        let mut steering = Steering::new(true);
        order(&mut steering, 5, Control::Resume).expect("taken");
        order(&mut steering, 9, Control::Pause).expect("taken");
        order(&mut steering, 9, Control::Resume).expect("taken");
        let said = order(&mut steering, 20, Control::Pause);
        said.expect("a pause may always come");
        order(&mut steering, 30, Control::Resume).expect_err("halted at 20");
        order(&mut steering, 20, Control::Resume).expect("at 20 it can");
        order(&mut steering, 30, Control::Resume).expect("and then at 30");
    }
}

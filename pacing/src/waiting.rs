//! What waits for its step, with a share of the room for each of those who ordered it.

use std::collections::{BTreeMap, BTreeSet};

/// Orders of one kind that one port may have waiting; more are refused, so that a runaway client neither eats the memory
/// nor takes the room of others.
pub const SHARE: usize = 4096;

/// Whether orders can be cancelled before `step`, when `next_step` is the first one still to come.
///
/// # Errors
/// A sentence: what is cancelled is cancelled at once.
pub fn check_cancel(step: u64, next_step: u64) -> Result<(), String> {
    if step <= next_step {
        return Ok(());
    }
    Err(format!(
        "apply_at_step is {step}, expected at most {next_step}: orders are cancelled at once"
    ))
}

/// When something takes effect, and who ordered it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Order {
    /// Step at whose start it takes effect.
    pub step: u64,
    /// Number of the client.
    pub client: u64,
    /// The client's running number.
    pub sequence: u64,
    /// The port it came by.
    pub port: u128,
    /// The request it came with.
    pub ticket: u64,
}

/// Order of application: by step, client, sequence and arrival.
type Place = (u64, u64, u64, u64);

/// Orders that wait, in the order of application.
#[derive(Debug)]
pub struct Waiting<T> {
    items: BTreeMap<Place, (Order, T)>,
    /// Orders that have come so far.
    arrived: u64,
    /// Orders that wait, by port.
    counts: BTreeMap<u128, usize>,
    /// Ports that are gone: what they ordered has one share all together.
    left: BTreeSet<u128>,
}

impl<T> Default for Waiting<T> {
    fn default() -> Waiting<T> {
        Waiting {
            items: BTreeMap::new(),
            arrived: 0,
            counts: BTreeMap::new(),
            left: BTreeSet::new(),
        }
    }
}

impl<T> Waiting<T> {
    /// How many wait.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// All that wait, in the order of application.
    pub fn iter(&self) -> impl Iterator<Item = (&Order, &T)> {
        self.items.values().map(|(order, what)| (order, what))
    }

    /// Whether `port` may have one more waiting.
    ///
    /// # Errors
    /// A sentence with how many wait, for `what`.
    pub fn has_room(&self, port: u128, what: &str) -> Result<(), String> {
        match self.counts.get(&port) {
            Some(count) if *count >= SHARE => Err(format!(
                "{count} orders of this client wait for {what} already, expected fewer than {SHARE}: cancel some, or give them later"
            )),
            _ => Ok(()),
        }
    }

    /// Takes in one more.
    pub fn push(&mut self, order: Order, what: T) {
        let place = (order.step, order.client, order.sequence, self.arrived);
        self.arrived += 1;
        *self.counts.entry(order.port).or_default() += 1;
        self.items.insert(place, (order, what));
    }

    /// Takes out what is due at `step` or before, in the order of application.
    pub fn take_due(&mut self, step: u64) -> Vec<(Order, T)> {
        let later = match step.checked_add(1) {
            Some(next) => self.items.split_off(&(next, 0, 0, 0)),
            None => BTreeMap::new(),
        };
        let due = std::mem::replace(&mut self.items, later);
        due.into_values()
            .inspect(|(order, _)| uncount(&mut self.counts, &mut self.left, order.port))
            .collect()
    }

    /// Takes out what `is_off`, in the order of application.
    pub fn call_off(&mut self, mut is_off: impl FnMut(&Order, &T) -> bool) -> Vec<(Order, T)> {
        let taken = self
            .items
            .extract_if(.., |_, (order, what)| is_off(order, what));
        taken
            .map(|(_, item)| item)
            .inspect(|(order, _)| uncount(&mut self.counts, &mut self.left, order.port))
            .collect()
    }

    /// `port` is gone, and what it ordered goes on waiting as far as all who are gone find room in one share: who has most
    /// waiting loses the last of it. Returns what was dropped.
    pub fn leave(&mut self, port: u128) -> Vec<(Order, T)> {
        if !self.counts.contains_key(&port) {
            return Vec::new();
        }
        self.left.insert(port);
        let counts = || self.left.iter().filter_map(|port| self.counts.get(port));
        let kept = |most: usize| counts().map(|count| most.min(*count)).sum::<usize>();
        let most = (0..=SHARE)
            .rev()
            .find(|most| kept(*most) <= SHARE)
            .unwrap_or(0);
        let mut surplus: BTreeMap<u128, usize> = self
            .left
            .iter()
            .filter_map(|port| Some((*port, self.counts.get(port)?.saturating_sub(most))))
            .filter(|(_, count)| *count > 0)
            .collect();
        let mut places = Vec::new();
        if !surplus.is_empty() {
            for (place, (order, _)) in self.items.iter().rev() {
                if let Some(count) = surplus.get_mut(&order.port).filter(|count| **count > 0) {
                    *count -= 1;
                    places.push(*place);
                }
            }
        }
        let dropped: Vec<_> = places
            .iter()
            .rev()
            .filter_map(|place| self.items.remove(place))
            .collect();
        for (order, _) in &dropped {
            uncount(&mut self.counts, &mut self.left, order.port);
        }
        dropped
    }
}

/// One order of `port` waits no more.
fn uncount(counts: &mut BTreeMap<u128, usize>, left: &mut BTreeSet<u128>, port: u128) {
    if let Some(count) = counts.get_mut(&port) {
        *count -= 1;
        if *count == 0 {
            counts.remove(&port);
            left.remove(&port);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(port: u128, step: u64, sequence: u64) -> Order {
        Order {
            step,
            client: 7,
            sequence,
            port,
            ticket: 0,
        }
    }

    /// Orders of a port for steps from `first` on, as many as there is room for.
    fn fill(waiting: &mut Waiting<u64>, port: u128, first: u64) -> usize {
        (first..)
            .take_while(|step| {
                let has_room = waiting.has_room(port, "a step").is_ok();
                if has_room {
                    waiting.push(order(port, *step, *step), *step);
                }
                has_room
            })
            .count()
    }

    #[test]
    fn what_is_due_comes_in_order_and_equals_as_they_came() {
        let mut waiting = Waiting::default();
        for (n, (port, step, sequence)) in [(9, 5, 1), (1, 5, 1), (1, 4, 3), (1, 6, 1)]
            .into_iter()
            .enumerate()
        {
            waiting.push(order(port, step, sequence), n);
        }
        let due: Vec<_> = waiting.take_due(5).iter().map(|(_, n)| *n).collect();
        assert_eq!((due, waiting.len()), (vec![2, 0, 1], 1));
        assert_eq!(waiting.take_due(u64::MAX).len(), 1);
        assert!(waiting.is_empty() && waiting.counts.is_empty());
    }

    #[test]
    fn each_port_has_a_share_of_its_own_and_gets_it_back() {
        let mut waiting = Waiting::default();
        assert_eq!(fill(&mut waiting, 1, 1), SHARE);
        let refused = waiting.has_room(1, "later steps").expect_err("full");
        assert!(
            refused.contains("4096 orders") && refused.len() <= 168,
            "{refused}"
        );
        assert_eq!(fill(&mut waiting, 2, 1), SHARE);
        assert_eq!(waiting.take_due(10).len(), 20);
        assert_eq!(fill(&mut waiting, 1, 9_000_000), 10);
        let off = waiting.call_off(|order, _| order.port == 1);
        assert_eq!((off.len(), waiting.len()), (SHARE, SHARE - 10));
        assert_eq!(waiting.has_room(1, "later steps"), Ok(()));
    }

    #[test]
    fn those_who_are_gone_share_the_room_of_one() {
        let mut waiting = Waiting::default();
        for port in 1..=3 {
            waiting.push(order(port, 8, 1), 8);
            assert_eq!(waiting.leave(port).len(), 0);
        }
        fill(&mut waiting, 4, 9);
        let dropped = waiting.leave(4);
        assert_eq!(waiting.len(), SHARE);
        // Who has most gives way, from the end.
        assert_eq!(dropped.len(), 3);
        assert!(
            dropped
                .iter()
                .all(|(order, step)| order.port == 4 && *step > 4100)
        );
        assert_eq!(waiting.leave(5).len(), 0, "it had ordered nothing");
        assert_eq!(waiting.take_due(u64::MAX).len(), SHARE);
        assert!(waiting.left.is_empty());
    }
}

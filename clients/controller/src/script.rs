//! Scripts: orders with the simulated time at which each takes effect.

use serde::Deserialize;

use crate::order::Order;

/// A scenario file: `[[order]]` tables.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// The orders, in any order of time.
    #[serde(default)]
    pub order: Vec<TimedOrder>,
}

/// An order with its time.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct TimedOrder {
    /// Simulated time [s] at which it takes effect; 0 or none means at once.
    #[serde(default)]
    pub time: f64,
    /// What to do.
    #[serde(flatten)]
    pub order: Order,
}

/// Why a script is refused.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// Not TOML, or an unknown key, action or type; the message has line and column.
    #[error("{0}")]
    Syntax(toml::de::Error),
    /// A time is negative or not finite.
    #[error("order {number}: time is {time}, expected a finite number of seconds >= 0")]
    Time {
        /// Which order, counted from 1.
        number: usize,
        /// The time given.
        time: f64,
    },
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// When the text is not a valid script.
    pub fn parse(text: &str) -> Result<Script, ScriptError> {
        let script: Script = toml::from_str(text).map_err(ScriptError::Syntax)?;
        for (index, timed) in script.order.iter().enumerate() {
            if !timed.time.is_finite() || timed.time < 0.0 {
                return Err(ScriptError::Time {
                    number: index + 1,
                    time: timed.time,
                });
            }
        }
        Ok(script)
    }
}

/// The step at whose start something at simulated `time` [s] takes effect: the first step that begins there.
pub fn step_at(time: f64, frame_rate: f64) -> u64 {
    // Times are written in decimal, frame boundaries are not: half a millionth of a frame is the same boundary.
    (time * frame_rate - 5e-7).ceil().max(0.0) as u64 + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::order::ObjectRef;

    #[test]
    fn a_script_is_orders_with_times() {
        let script = Script::parse(
            "[[order]]\naction = 'resume'\n\n[[order]]\ntime = 0.5\naction = 'push'\nobject = 'left'\nimpulse = [1, 0, 0]\n",
        )
        .expect("valid script");
        assert_eq!(script.order.len(), 2);
        assert_eq!(script.order[1].time, 0.5);
        let Order::Push { object, .. } = &script.order[1].order else {
            panic!("second order is a push");
        };
        assert_eq!(*object, ObjectRef::Name("left".into()));
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        let error = Script::parse("[[order]]\naction = 'shove'\n").expect_err("no such action");
        assert!(error.to_string().contains("shove"), "{error}");
        let error = Script::parse("[[order]]\ntime = -1.0\naction = 'pause'\n").expect_err("past");
        assert!(error.to_string().contains("-1"), "{error}");
    }

    #[test]
    fn times_on_a_frame_boundary_start_the_next_step() {
        assert_eq!(step_at(0.0, 60.0), 1);
        assert_eq!(step_at(0.5, 60.0), 31);
        assert_eq!(step_at(0.1 + 0.2, 10.0), 4);
        assert_eq!(step_at(0.501, 60.0), 32);
    }
}

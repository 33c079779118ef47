//! Formulas of scene files: numbers and vectors as functions of the place at rest and of time.

use std::{f64::consts::PI, fmt, sync::Arc};

/// What a formula may depend on: the particle's position at rest [m], world frame, and time [s].
pub const VARIABLES: [&str; 4] = ["X", "Y", "Z", "t"];

type Function = fn(f64) -> f64;

/// Functions of one number.
const FUNCTIONS: [(&str, Function); 13] = [
    ("abs", f64::abs),
    ("sqrt", f64::sqrt),
    ("exp", f64::exp),
    ("ln", f64::ln),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("sinh", f64::sinh),
    ("cosh", f64::cosh),
    ("tanh", f64::tanh),
];

/// Deepest nesting, and most numbers that evaluation holds at a time.
const DEPTH: usize = 32;

/// Step of the differences behind the gradient of an initial velocity [cells]: their error is this squared, and a few
/// digits more than single precision has.
pub const GRADIENT_STEP: f64 = 1e-4;

/// A formula in X, Y, Z and t.
#[derive(Clone)]
pub struct Expression {
    text: String,
    code: Code,
}

/// A formula as a stack machine runs it, in postfix order.
#[derive(Clone, Debug, Default)]
struct Code(Vec<Op>);

/// One instruction of a stack machine.
#[derive(Clone, Copy, Debug)]
enum Op {
    Number(f64),
    Variable(usize),
    Apply(Function),
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
}

impl Expression {
    /// Parses a formula: numbers, `+ - * / ^`, parentheses, `pi`, and functions such as `sin`, `exp` and `sqrt`.
    /// `-X^2` is `-(X^2)`, and `2^3^2` is `2^(3^2)`.
    ///
    /// # Errors
    /// What is wrong with it and where, as a sentence.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parser = Parser {
            text,
            at: 0,
            depth: 0,
            held: 0,
            code: Code::default(),
        };
        parser.sum()?;
        match parser.peek() {
            None => Ok(Self {
                text: text.into(),
                code: parser.code,
            }),
            Some(_) => parser.fail("expected an operator"),
        }
    }

    /// Its value at rest position `x` [m] and time `t` [s]; NaN or infinite where it has none.
    pub fn value(&self, x: [f64; 3], t: f64) -> f64 {
        self.code.value([x[0], x[1], x[2], t])
    }
}

impl Op {
    /// Its result from the numbers on top of the stack; of one number, that is `b`.
    fn of(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Number(value) => value,
            Self::Variable(_) => f64::NAN,
            Self::Apply(function) => function(b),
            Self::Negate => -b,
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power if b == 2.0 => a * a,
            Self::Power => a.powf(b),
        }
    }
}

impl Code {
    fn value(&self, variables: [f64; 4]) -> f64 {
        let mut stack = [0.0; DEPTH];
        let mut top = 0;
        for op in &self.0 {
            match *op {
                Op::Number(value) => (stack[top], top) = (value, top + 1),
                Op::Variable(n) => (stack[top], top) = (variables[n], top + 1),
                Op::Apply(_) | Op::Negate => stack[top - 1] = op.of(0.0, stack[top - 1]),
                Op::Add | Op::Subtract | Op::Multiply | Op::Divide | Op::Power => {
                    top -= 1;
                    stack[top - 1] = op.of(stack[top - 1], stack[top]);
                }
            }
        }
        stack[0]
    }

    /// The same at one time `t` [s], with every part that does not depend on the place worked out: the same operations
    /// on the same numbers, so that values are the same bit for bit.
    fn at_time(&self, t: f64) -> Self {
        let mut code: Vec<Op> = Vec::with_capacity(self.0.len());
        for op in &self.0 {
            // The last instruction makes the number on top of the stack. When it is a number itself, then the one before
            // it makes the number below.
            let known = match (*op, code.as_slice()) {
                (Op::Number(_) | Op::Variable(_), _) => None,
                (Op::Apply(_) | Op::Negate, [.., Op::Number(b)]) => Some((1, op.of(0.0, *b))),
                (Op::Apply(_) | Op::Negate, _) => None,
                (_, [.., Op::Number(a), Op::Number(b)]) => Some((2, op.of(*a, *b))),
                _ => None,
            };
            match (*op, known) {
                (Op::Variable(n), _) if VARIABLES[n] == "t" => code.push(Op::Number(t)),
                (_, Some((count, value))) => {
                    code.truncate(code.len() - count);
                    code.push(Op::Number(value));
                }
                (op, None) => code.push(op),
            }
        }
        Self(code)
    }

    /// Its value, if it is one number.
    fn number(&self) -> Option<f64> {
        match self.0.as_slice() {
            [Op::Number(value)] => Some(*value),
            _ => None,
        }
    }
}

/// Recursive descent over the grammar of school.
struct Parser<'t> {
    text: &'t str,
    /// Next byte.
    at: usize,
    /// Levels of nesting at present.
    depth: usize,
    /// Numbers on the stack at present.
    held: usize,
    code: Code,
}

impl Parser<'_> {
    fn fail<T>(&self, message: &str) -> Result<T, String> {
        let column = self.text[..self.at].chars().count() + 1;
        let found = match self.text[self.at..].chars().next() {
            Some(c) => format!("found `{c}`"),
            None => "found its end".into(),
        };
        Err(format!(
            "{message} at character {column} of the formula, {found}"
        ))
    }

    /// The next character that is not a space.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    /// Whether the next character is this one, which is then taken.
    fn takes(&mut self, c: char) -> bool {
        let found = self.peek() == Some(c);
        if found {
            self.at += c.len_utf8();
        }
        found
    }

    fn push(&mut self, op: Op) -> Result<(), String> {
        match op {
            Op::Number(_) | Op::Variable(_) => self.held += 1,
            Op::Apply(_) | Op::Negate => {}
            Op::Add | Op::Subtract | Op::Multiply | Op::Divide | Op::Power => self.held -= 1,
        }
        if self.held > DEPTH {
            return self.fail("is nested too deeply");
        }
        self.code.0.push(op);
        Ok(())
    }

    fn sum(&mut self) -> Result<(), String> {
        self.depth += 1;
        if self.depth > DEPTH {
            return self.fail("is nested too deeply");
        }
        self.product()?;
        loop {
            let op = match self.peek() {
                Some('+') => Op::Add,
                Some('-') => Op::Subtract,
                _ => break,
            };
            self.at += 1;
            self.product()?;
            self.push(op)?;
        }
        self.depth -= 1;
        Ok(())
    }

    fn product(&mut self) -> Result<(), String> {
        self.signed()?;
        loop {
            let op = match self.peek() {
                Some('*') => Op::Multiply,
                Some('/') => Op::Divide,
                _ => return Ok(()),
            };
            self.at += 1;
            self.signed()?;
            self.push(op)?;
        }
    }

    fn signed(&mut self) -> Result<(), String> {
        let mut negative = false;
        loop {
            if self.takes('-') {
                negative = !negative;
            } else if !self.takes('+') {
                break;
            }
        }
        self.power()?;
        if negative {
            self.push(Op::Negate)?;
        }
        Ok(())
    }

    fn power(&mut self) -> Result<(), String> {
        self.atom()?;
        if self.takes('^') {
            self.depth += 1;
            if self.depth > DEPTH {
                return self.fail("is nested too deeply");
            }
            self.signed()?;
            self.depth -= 1;
            self.push(Op::Power)?;
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<(), String> {
        match self.peek() {
            Some('(') => self.parenthesis(),
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() => self.name(),
            _ => self.fail("expected a number, a name or `(`"),
        }
    }

    fn parenthesis(&mut self) -> Result<(), String> {
        if !self.takes('(') {
            return self.fail("expected `(`");
        }
        self.sum()?;
        if !self.takes(')') {
            return self.fail("expected `)`");
        }
        Ok(())
    }

    fn number(&mut self) -> Result<(), String> {
        let bytes = self.text.as_bytes();
        let digits = |mut at: usize| {
            while bytes.get(at).is_some_and(u8::is_ascii_digit) {
                at += 1;
            }
            at
        };
        let mut end = digits(self.at);
        if bytes.get(end) == Some(&b'.') {
            end = digits(end + 1);
        }
        if matches!(bytes.get(end), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
            end = digits(end + 1 + sign);
        }
        let Ok(value) = self.text[self.at..end].parse() else {
            return self.fail("expected a number");
        };
        self.at = end;
        self.push(Op::Number(value))
    }

    fn name(&mut self) -> Result<(), String> {
        let rest = &self.text[self.at..];
        let length = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let name = &rest[..length.unwrap_or(rest.len())];
        if let Some(n) = VARIABLES.iter().position(|v| *v == name) {
            self.at += name.len();
            return self.push(Op::Variable(n));
        }
        if name == "pi" {
            self.at += name.len();
            return self.push(Op::Number(PI));
        }
        let Some((_, function)) = FUNCTIONS.iter().find(|(known, _)| *known == name) else {
            let functions = FUNCTIONS.map(|(known, _)| known).join(", ");
            let variables = VARIABLES.join(", ");
            let message = format!("expected {variables}, pi or one of {functions}");
            return self.fail(&message);
        };
        self.at += name.len();
        self.parenthesis()?;
        self.push(Op::Apply(*function))
    }
}

impl fmt::Debug for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.text, f)
    }
}

impl PartialEq for Expression {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

/// A vector as a function of the place at rest and of time, one formula per component.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorField(Arc<[Expression; 3]>);

impl VectorField {
    /// Of three formulas.
    pub fn new(components: [Expression; 3]) -> Self {
        Self(Arc::new(components))
    }

    /// The vector at rest position `x` [m] and time `t` [s].
    pub fn at(&self, x: [f64; 3], t: f64) -> [f64; 3] {
        std::array::from_fn(|a| self.0[a].value(x, t))
    }

    /// Whether it depends on time.
    pub fn varies_in_time(&self) -> bool {
        let timed = |op: &Op| matches!(op, Op::Variable(n) if VARIABLES[*n] == "t");
        self.0
            .iter()
            .any(|formula| formula.code.0.iter().any(timed))
    }

    /// The field at one time `t` [s]. Its values are those of [`at`](Self::at), bit for bit.
    pub fn at_time(&self, t: f64) -> Snapshot {
        let code = std::array::from_fn(|a| self.0[a].code.at_time(t));
        let numbers: [Option<f64>; 3] = std::array::from_fn(|a: usize| Code::number(&code[a]));
        match numbers {
            [Some(x), Some(y), Some(z)] => Snapshot::Uniform([x, y, z]),
            _ => Snapshot::Varying(Formulas(code)),
        }
    }

    /// Its gradient there, row-major, by central differences over `h` [m] to either side.
    pub fn gradient(&self, x: [f64; 3], t: f64, h: f64) -> [[f64; 3]; 3] {
        let mut gradient = [[0.0; 3]; 3];
        for b in 0..3 {
            let beside = |h: f64| {
                let mut x = x;
                x[b] += h;
                self.at(x, t)
            };
            let (behind, ahead) = (beside(-h), beside(h));
            for a in 0..3 {
                gradient[a][b] = (ahead[a] - behind[a]) / (2.0 * h);
            }
        }
        gradient
    }
}

/// A [`VectorField`] at one time, worked out as far as it can be without a place.
#[derive(Clone, Debug)]
pub enum Snapshot {
    /// The same everywhere.
    Uniform([f64; 3]),
    /// To be evaluated at places.
    Varying(Formulas),
}

/// Three formulas in X, Y and Z.
#[derive(Clone, Debug)]
pub struct Formulas([Code; 3]);

impl Formulas {
    /// The vector at rest position `x` [m].
    pub fn at(&self, x: [f64; 3]) -> [f64; 3] {
        // No instruction reads the time any more.
        self.0
            .each_ref()
            .map(|code| code.value([x[0], x[1], x[2], f64::NAN]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str, x: [f64; 3], t: f64) -> f64 {
        Expression::parse(text).expect(text).value(x, t)
    }

    #[test]
    fn formulas_mean_what_they_mean_on_paper() {
        let x = [3.0, 0.5, -2.0];
        for (text, expected) in [
            ("2", 2.0),
            ("2.", 2.0),
            (".5", 0.5),
            ("1e3 + 2.5E-1", 1000.25),
            ("-X^2", -9.0),
            ("(-X)^2", 9.0),
            ("2*-1^2", -2.0),
            ("2^-1", 0.5),
            ("2^3^2", 512.0),
            ("--X", 3.0),
            ("1 - X^2", -8.0),
            ("exp(-X^2 + 9)", 1.0),
            ("12/2/3", 2.0),
            ("12/2*3", 18.0),
            ("2 - 3 - 4", -5.0),
            ("2*3 + 4*Z", -2.0),
            ("0.1*sin(pi*X/6)", 0.1),
            ("cos(pi*t)", -1.0),
            ("sqrt(X^2 + Z^2 + 3)", 4.0),
            ("t", 1.0),
        ] {
            let found = value(text, x, 1.0);
            assert!((found - expected).abs() < 1e-12, "{text}: {found}");
        }
    }

    #[test]
    fn bad_formulas_are_errors() {
        let deep = "(".repeat(200);
        let long = "2^".repeat(200);
        for text in [
            &deep, &long, "2e", "e5", "sin 2", "", "2*", "W + 1", "sin(X", "{X}", "X X", "2 é",
            "sin", "1.2.3", "X, Y", "()", "-",
        ] {
            assert!(Expression::parse(text).is_err(), "{text}");
        }
        let error = Expression::parse("2*x").expect_err("x is not X");
        assert!(
            error.contains("X, Y, Z, t") && error.contains("character 3") && error.contains("`x`"),
            "{error}"
        );
    }

    #[test]
    fn gradients_are_those_of_the_formulas() {
        let parts = ["X*Y", "sin(Z)", "t*X"].map(|text| Expression::parse(text).expect(text));
        let gradient = VectorField::new(parts).gradient([2.0, 3.0, 0.0], 5.0, 1e-4);
        let expected = [[3.0, 2.0, 0.0], [0.0, 0.0, 1.0], [5.0, 0.0, 0.0]];
        for a in 0..3 {
            for b in 0..3 {
                // Truncation h^2 / 6 of the sine, and round-off 1e-16 / h.
                assert!(
                    (gradient[a][b] - expected[a][b]).abs() < 1e-8,
                    "{gradient:?}"
                );
            }
        }
    }

    #[test]
    fn a_field_at_one_time_is_the_field_then_bit_for_bit() {
        let places = [[0.3, -0.7, 1.9], [-2.0, 0.0, 0.1]];
        for text in [
            "sin(pi*t)*X + 2^t*cos(3*t + Y)/(1 + t^2) - t*Z^(t/2)",
            "-(t - 0.1)*(X - 2*t)*exp(-(t/0.1)^2)",
            "t + 0*X",
            "1/(t - t)",
            "2*t",
        ] {
            let field = VectorField::new([text, "Y", "t"].map(|t| Expression::parse(t).expect(t)));
            for t in [0.0, 0.137, 2.5] {
                for x in places {
                    let then = match field.at_time(t) {
                        Snapshot::Uniform(vector) => vector,
                        Snapshot::Varying(formulas) => formulas.at(x),
                    };
                    let bits = |v: [f64; 3]| v.map(f64::to_bits);
                    assert_eq!(bits(then), bits(field.at(x, t)), "{text} at {x:?}, {t} s");
                }
            }
        }
    }

    #[test]
    fn what_does_not_depend_on_place_is_one_number_at_one_time() {
        for (text, operations) in [
            ("-9.81*(1 - exp(-(t/0.1)^2))", 1),
            ("2*pi", 1),
            // The number, X, the product.
            ("2*pi*t*X", 3),
            // Not worked out: X may be infinite.
            ("0*X", 3),
        ] {
            let code = Expression::parse(text).expect(text).code;
            assert_eq!(code.at_time(0.3).0.len(), operations, "{text}");
        }
    }
}

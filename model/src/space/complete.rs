//! A whole configuration from some values, for people and programs.

use crate::assignment::Assignment;
use crate::configuration::{Configuration, RawConfiguration};
use crate::space::{Constraint, Domain, Parameter, Space, SpaceError};
use crate::value::Value;

impl Space {
    /// A whole configuration from some values, completed with the recommended ones.
    ///
    /// A value implies its conditions: where `bins` exists only with `split = sah`, `bins = 8` alone means
    /// that split. Where a given and a recommended value break a constraint, the recommended one gives way.
    /// Float parameters also take whole numbers, so that people may write `2` for `2.0`.
    ///
    /// # Errors
    /// [`SpaceError`] with the value that is unknown, inactive or outside its domain, or the constraint that
    /// is broken.
    pub fn complete(&self, given: &Assignment) -> Result<Configuration, SpaceError> {
        let parameters = self.parameters();
        let given = self.with_needs(given);
        let mut whole = RawConfiguration::new();
        for parameter in parameters {
            let active = parameter.is_active(&whole);
            match given.get(&parameter.name) {
                // A value that is given and inactive is refused below.
                Some(value) => whole.insert(parameter.name.clone(), parameter.domain.as_of(value)),
                None if active => whole.insert(parameter.name.clone(), parameter.default.clone()),
                None => None,
            };
        }
        for (lesser, greater) in self.constraints().iter().filter_map(Constraint::as_order) {
            let (Some(low), Some(high)) = (whole.get(lesser), whole.get(greater)) else { continue };
            if low.as_number() <= high.as_number() {
                continue;
            }
            match (given.contains_key(lesser), given.contains_key(greater)) {
                (false, _) => whole.insert(lesser.to_owned(), high.clone()),
                (_, false) => whole.insert(greater.to_owned(), low.clone()),
                (true, true) => None,
            };
        }
        if self.has_expressions() && parameters.iter().all(|one| one.domain.holds(whole.get(&one.name))) {
            self.give_way(&given, &mut whole);
        }
        let unknown = given.into_iter().find(|(name, _)| parameters.iter().all(|one| one.name != *name));
        whole.extend(unknown);
        self.configuration(whole)
    }

    /// Moves recommended values so that constraints hold, if that helps.
    fn give_way(&self, given: &RawConfiguration, whole: &mut RawConfiguration) {
        let value = |one: &Parameter| whole.get(&one.name).unwrap_or(&one.default).clone();
        let mut values: Vec<Value> = self.parameters().iter().map(value).collect();
        let is_given = |index: usize| given.contains_key(&self.parameters()[index].name);
        if self.move_around(&mut values, is_given) {
            let kept = given.keys().filter_map(|name| Some((name.clone(), whole.get(name)?.clone())));
            let mut moved: RawConfiguration = self.collect(&values, &self.active(&values)).into();
            // A value that is given and inactive is refused later.
            moved.extend(kept.collect::<Vec<_>>());
            *whole = moved;
        }
    }

    /// Adds the values that given ones need, where these are not given themselves. Conditions name earlier
    /// parameters, so that one walk from the last to the first follows every chain.
    fn with_needs(&self, given: &Assignment) -> RawConfiguration {
        let mut given = given.as_raw().clone();
        for (index, parameter) in self.parameters().iter().enumerate().rev() {
            let Some(condition) =
                parameter.active_if.as_ref().filter(|_| given.contains_key(&parameter.name))
            else {
                continue;
            };
            let needed = self.condition_of[index].map(|needed| &self.parameters()[needed]);
            if let Some(needed) = needed.filter(|needed| !given.contains_key(&needed.name)) {
                let fits = condition.any_of.contains(&needed.default);
                let value = if fits { &needed.default } else { &condition.any_of[0] };
                given.insert(needed.name.clone(), value.clone());
            }
        }
        given
    }
}

impl Domain {
    /// Whether a value is of this domain, if there is one.
    fn holds(&self, value: Option<&Value>) -> bool {
        value.is_none_or(|value| self.contains(value))
    }

    /// The value in the domain's kind: whole numbers become floats.
    pub fn as_of(&self, value: &Value) -> Value {
        let floats = match self {
            Domain::Float { .. } => true,
            Domain::Categorical { values } => matches!(values.first(), Some(Value::Float(_))),
            Domain::Integer { .. } | Domain::Boolean => false,
        };
        match value {
            Value::Integer(integer) if floats => Value::Float(*integer as f64),
            other => other.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space() -> Space {
        Space::builder()
            .categorical("split", ["sah", "median"])
            .default("sah")
            .float("cost", 0.5..=4.0)
            .default(1.0)
            .active_if("split", ["sah"])
            .boolean("shallow")
            .default(false)
            .active_if("split", ["median"])
            .integer("low", 1..=9)
            .default(3)
            .integer("high", 1..=9)
            .default(5)
            .less_or_equal("low", "high")
            .build()
            .expect("a space")
    }

    fn complete(given: Assignment) -> Result<String, String> {
        let whole = space().complete(&given).map_err(|error| error.to_string())?;
        Ok(Assignment::from(whole).to_string())
    }

    #[test]
    fn some_values_make_a_whole_configuration() {
        let new = Assignment::new;
        assert_eq!(complete(new().with("cost", 2)).as_deref(), Ok("cost=2.0 high=5 low=3 split=sah"));
        let median = complete(new().with("split", "median"));
        assert_eq!(median.as_deref(), Ok("high=5 low=3 shallow=false split=median"));
        assert_eq!(complete(new().with("shallow", false)), median, "it takes along what it needs");
        let low = complete(new().with("high", 2));
        assert_eq!(low.as_deref(), Ok("cost=1.0 high=2 low=2 split=sah"), "the recommended value gives way");
    }

    #[test]
    fn recommended_values_give_way_to_expressions() {
        let space = Space::builder().integer("x", 1..=1024).default(32).integer("y", 1..=1024).default(32);
        let space = space.constraint("x * y <= 1024 and y % 2 == 0").build().expect("a space");
        let complete = |given: Assignment| {
            space.complete(&given).map(|whole| whole.to_string()).map_err(|error| error.to_string())
        };
        let new = Assignment::new;
        assert_eq!(complete(new().with("x", 90)).as_deref(), Ok("x=90;y=10"));
        assert_eq!(complete(new().with("x", 9)).as_deref(), Ok("x=9;y=32"), "nothing has to give way");
        let problem = complete(new().with("x", 90).with("y", 90)).expect_err("both are given");
        assert!(problem.contains("x = 90, y = 90 break the constraint"), "{problem}");
        let problem = complete(new().with("x", 1000)).expect_err("there is no such y");
        assert!(problem.contains("x = 1000, y = 32 break"), "{problem}");
        let problem = complete(new().with("x", "wide")).expect_err("no number");
        assert!(problem.contains("must be a whole number"), "{problem}");
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let problem = |given: Assignment| complete(given).expect_err("does not fit");
        let new = Assignment::new;
        assert!(
            problem(new().with("colour", 1)).contains("\"colour\" is unknown; the space has split, cost")
        );
        assert!(problem(new().with("low", 10)).contains("10; it must be a whole number from 1 to 9"));
        assert!(problem(new().with("split", "median").with("cost", 1.0)).contains("it needs split = sah"));
        let said = problem(new().with("low", 6).with("high", 4));
        assert!(said.contains("low = 6, high = 4 break the constraint `low <= high`"), "{said}");
    }
}

//! The solvers that take part, by the names that the centre's configuration knows.

use anyhow::{Context, bail, ensure};
use fusion_center::registration::{Solver, SolverConfig, SolverKind, build};
use serde::de::value::{Error as NameError, StrDeserializer};
use serde::de::{Error as _, IntoDeserializer, Visitor};
use serde::{Deserialize, Deserializer, forward_to_deserialize_any};

use super::Figure;

/// The name that takes a number of particles.
const SWARM: &str = "swarm";

/// A solver under the name that the results bear.
pub(super) struct Entrant {
    /// As it was asked for, such as `default` or `swarm:100`.
    pub(super) name: String,
    pub(super) solver: Box<dyn Solver>,
}

impl Entrant {
    /// The solver called `name`, which is one of [`names`], for the swarm with `:` and its number of
    /// particles if that is not the configured one.
    ///
    /// # Errors
    /// If there is none of this name; lists all.
    pub(super) fn of(name: &str) -> anyhow::Result<Self> {
        let (kind, particles) = name.split_once(':').map_or((name, None), |(k, p)| (k, Some(p)));
        let known = names();
        if !known.contains(&kind) {
            bail!("--solvers {name}: there is no such solver; use {}", known.join(", "));
        }
        let deserializer: StrDeserializer<'_, NameError> = kind.into_deserializer();
        let mut config = SolverConfig {
            kind: SolverKind::deserialize(deserializer)?,
            ..SolverConfig::default()
        };
        if let Some(text) = particles {
            ensure!(kind == SWARM, "--solvers {name}: only the swarm takes a number of particles");
            let count = text.parse();
            config.swarm.particle_count = count.with_context(|| {
                format!("--solvers {name}: {text:?} is no number of particles; use for example swarm:100")
            })?;
        }
        config.check().with_context(|| format!("--solvers {name}"))?;
        Ok(Self { name: name.to_owned(), solver: build(&config) })
    }
}

/// The solvers that a figure compares, as far as they exist.
pub(super) fn usual(figure: Figure) -> Vec<String> {
    let wanted: &[&str] = match figure {
        Figure::Fig6 => &["default", "swarm:500", "swarm:100"],
        Figure::Fig7 => &["default", "graph", "swarm:500", "swarm:100"],
        Figure::Fig10 => &["default", "swarm"],
    };
    let known = names();
    let exists = |name: &&&str| name.split(':').next().is_some_and(|kind| known.contains(&kind));
    wanted.iter().filter(exists).map(|name| (*name).to_owned()).collect()
}

/// The names of all solvers, taken from [`SolverKind`] itself.
pub(super) fn names() -> &'static [&'static str] {
    let mut names: &'static [&'static str] = &[];
    // The kind tells its names to whatever it is read from, and is then refused a value.
    drop(SolverKind::deserialize(NameCollector(&mut names)));
    names
}

/// Notes the variants that a type could have and yields no value.
struct NameCollector<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for NameCollector<'_> {
    type Error = NameError;

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        variants: &'static [&'static str],
        _visitor: V,
    ) -> Result<V::Value, NameError> {
        *self.0 = variants;
        Err(NameError::custom("only names are wanted"))
    }

    fn deserialize_any<V: Visitor<'de>>(self, _visitor: V) -> Result<V::Value, NameError> {
        Err(NameError::custom("not a list of names"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option
        unit unit_struct newtype_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_builds_a_solver_and_an_unknown_one_lists_them() {
        assert!(names().contains(&"default") && names().contains(&"swarm"), "{:?}", names());
        for name in names() {
            assert_eq!(Entrant::of(name).unwrap().name, *name);
        }
        let complaint = Entrant::of("magic").err().unwrap().to_string();
        assert!(complaint.contains("magic") && complaint.contains("default, swarm"), "{complaint}");
    }

    #[test]
    fn only_the_swarm_takes_particles_and_only_a_number_of_them() {
        assert_eq!(Entrant::of("swarm:100").unwrap().solver.name(), "swarm");
        let complaint = |name| format!("{:#}", Entrant::of(name).err().unwrap());
        assert!(complaint("default:3").contains("only the swarm"));
        assert!(complaint("swarm:many").contains("\"many\""));
        assert!(complaint("swarm:0").contains("particle_count is 0"));
    }

    #[test]
    fn figures_compare_only_solvers_that_exist() {
        for figure in [Figure::Fig6, Figure::Fig7, Figure::Fig10] {
            let usual = usual(figure);
            assert_eq!(usual[0], "default");
            assert!(usual.iter().all(|name| Entrant::of(name).is_ok()), "{usual:?}");
        }
    }
}

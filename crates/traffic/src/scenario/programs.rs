//! Which program of a light counts: the last one, unless somebody chooses another.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, ensure};

use crate::agents::derive::overrides::Overrides;
use crate::network::roads::program::name;
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// What a choice has changed. Plain SUMO, which loads the files as they are, does not know it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Chosen {
    /// Lights whose program was chosen.
    pub(crate) lights: Vec<String>,
    /// Those of them that a `<WAUT>` would switch to other programs.
    pub(crate) switched: Vec<String>,
}

/// The choice of a config and of its `agents.toml`.
#[derive(Debug, Default)]
pub(super) struct Choice {
    everywhere: Option<String>,
    by_light: BTreeMap<String, String>,
}

impl Choice {
    pub(super) fn of(everywhere: Option<String>, overrides: &Overrides) -> Choice {
        let by_light = overrides.programs().map(|(light, program)| (light.to_owned(), program.to_owned())).collect();
        Choice { everywhere, by_light }
    }

    /// Returns whether a program is the one that was chosen for its light.
    fn is_it(&self, program: &Element) -> bool {
        let light = program.attribute("id").unwrap_or_default();
        self.by_light.get(light).or(self.everywhere.as_ref()).is_some_and(|wanted| wanted == name(program))
    }

    /// Takes out the programs that come after the chosen ones, so that SUMO runs these, and what would switch to another one.
    /// `roots`: of the net and the additional files, in SUMO's order, each with whether it was changed. `scenario`: its path.
    /// Returns the lights that this concerns.
    pub(super) fn apply<'a>(
        &self,
        scenario: &Path,
        roots: impl Iterator<Item = (&'a mut Element, &'a mut bool)>,
    ) -> Result<Chosen> {
        let mut roots: Vec<_> = roots.collect();
        let chosen: Vec<String> = {
            let programs = roots.iter().flat_map(|(root, _)| root.all("tlLogic")).filter(|program| self.is_it(program));
            programs.filter_map(|program| program.attribute("id")).map(str::to_owned).collect()
        };
        for (light, wanted) in &self.by_light {
            ensure!(
                chosen.contains(light),
                "agents.toml: light `{light}`: program: it has none of the name `{}`",
                excerpt(wanted)
            );
        }
        if let Some(wanted) = &self.everywhere {
            ensure!(
                chosen.iter().any(|light| !self.by_light.contains_key(light)),
                "{}: no light has a program of the name `{}`; leave it out, and the last program of each light counts",
                scenario.display(),
                excerpt(wanted)
            );
        }
        let mut seen: Vec<&str> = Vec::new();
        let mut switched = Vec::new();
        for (root, is_changed) in &mut roots {
            let before = root.children.len();
            root.children.retain(|child| {
                let id = |key: &str| child.attribute(key).unwrap_or_default();
                let of_chosen = |light: &str| chosen.iter().find(|other| *other == light);
                match &*child.name {
                    "tlLogic" if self.is_it(child) => {
                        seen.extend(of_chosen(id("id")).map(String::as_str));
                        true
                    }
                    "tlLogic" => !seen.contains(&id("id")),
                    "wautJunction" => {
                        switched.extend(of_chosen(id("junctionID")).cloned());
                        of_chosen(id("junctionID")).is_none()
                    }
                    _ => true,
                }
            });
            **is_changed |= root.children.len() < before;
        }
        Ok(Chosen { lights: chosen, switched })
    }
}

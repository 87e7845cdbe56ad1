//! Reading the command line of this process.

use clap::{Command, CommandFactory, FromArgMatches};

use super::Cli;

impl Cli {
    /// Reads the command line of this process. If it is wrong, prints why and ends the process.
    pub fn of_this_process() -> Cli {
        let matches = with_negative_numbers(Cli::command()).get_matches();
        Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
    }
}

/// Lets all values be negative numbers, which their own checks then refuse. Otherwise clap takes one for an option, and its
/// advice would make it a file.
fn with_negative_numbers(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let takes_values = arg.get_action().takes_values();
        arg.allow_negative_numbers(takes_values)
    });
    command.mut_subcommands(with_negative_numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_negative_number_is_refused_as_the_value_that_it_is() {
        let message = |line: &str| {
            let words = ["dials-traffic"].into_iter().chain(line.split(' '));
            let error = with_negative_numbers(Cli::command()).try_get_matches_from(words).unwrap_err();
            error.to_string().lines().next().unwrap_or_default().to_owned()
        };
        for line in ["train a.toml --steps -5", "evaluate a --episodes -1", "train a.toml --seed -1"] {
            assert!(message(line).starts_with("error: invalid value '-"), "{line}: {}", message(line));
        }
    }
}

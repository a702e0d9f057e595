//! Settings of the window from a file and the environment. Precedence: command line > `LIGHTSKIN_*` > file > default.

use super::Cli;
use anyhow::{Context, Result, anyhow, bail};
use clap::parser::ValueSource;
use clap::{Command, CommandFactory, Subcommand};
use lightskin::files;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

#[derive(Subcommand)]
pub(super) enum Config {
    /// Print every setting of `lightskin view`, its value, and where the value comes from.
    Show {
        /// Flags of `lightskin view` to take into account.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "FLAGS")]
        flags: Vec<OsString>,
    },
}

/// Flags that cannot be settings, because they belong to a single run or conflict with another flag.
const LEFT_OUT: [&str; 8] = ["help", "version", "against", "camera", "dev", "ev", "sky-color", "spacing"];

/// Path of the settings file: `lightskin/settings.toml` under `$XDG_CONFIG_HOME`, or else under `$HOME/.config`
/// (Windows: `%APPDATA%`). `None` if neither is set.
fn file() -> Option<PathBuf> {
    let set = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let usual = || if cfg!(windows) { set("APPDATA") } else { set("HOME").map(|home| home.join(".config")) };
    let folder = set("XDG_CONFIG_HOME").or_else(usual);
    folder.map(|folder| folder.join("lightskin/settings.toml"))
}

/// Flags of `view` that the settings file may set.
fn names() -> Vec<String> {
    let command = Cli::command();
    let view = command.find_subcommand("view");
    let long = view.into_iter().flat_map(Command::get_arguments).filter_map(|arg| arg.get_long());
    long.filter(|name| !LEFT_OUT.contains(name)).map(str::to_owned).collect()
}

/// The environment variable of a flag.
fn variable(name: &str) -> String {
    format!("LIGHTSKIN_{}", name.to_uppercase().replace('-', "_"))
}

/// Names and values in the settings file. Empty without a file.
fn settings() -> Result<Vec<(String, String)>> {
    let Some(path) = file().filter(|path| path.exists()) else { return Ok(Vec::new()) };
    read(&path).with_context(|| path.display().to_string())
}

fn read(path: &Path) -> Result<Vec<(String, String)>> {
    let bytes = files::read(path).map_err(|reason| anyhow!(reason))?;
    let text = String::from_utf8(bytes).context("needs text in UTF-8")?;
    let table: Table =
        text.parse().map_err(|error: toml::de::Error| anyhow!("{}", error.to_string().trim().replace('\n', " ")))?;
    let known = names();
    let setting = |(name, value): (String, Value)| {
        if !known.contains(&name) {
            bail!("{name}: no setting has this name; known settings are {}", known.join(", "));
        }
        let text = match value {
            Value::String(text) => text,
            Value::Integer(number) => number.to_string(),
            Value::Float(number) => number.to_string(),
            Value::Boolean(on) => on.to_string(),
            _ => bail!("{name}: needs a string, a number, true or false"),
        };
        let switch = text == "true" || text == "false";
        let words = if switch { vec![format!("--{name}")] } else { vec![format!("--{name}"), text.clone()] };
        let all = ["lightskin".to_owned(), "view".to_owned()].into_iter().chain(words);
        if let Err(error) = super::grammar().try_get_matches_from(all) {
            let said = error.to_string();
            bail!("{name}: {}", said.lines().next().unwrap_or_default().trim_start_matches("error: "));
        }
        Ok((name, text))
    };
    table.into_iter().map(setting).collect()
}

/// The grammar of the command line, with defaults from the settings file and the environment.
pub(super) fn grammar() -> Result<Command> {
    let (names, settings) = (names(), settings()?);
    Ok(super::grammar().mut_subcommand("view", |view| {
        view.mut_args(|arg| {
            let Some(name) = arg.get_long().filter(|name| names.iter().any(|n| n == name)).map(str::to_owned) else {
                return arg;
            };
            let arg = arg.env(variable(&name)).hide_env(true);
            match settings.iter().find(|(set, _)| *set == name) {
                Some((_, value)) => arg.default_value(value.clone()),
                None => arg,
            }
        })
    }))
}

pub(super) fn run(config: &Config) -> Result<()> {
    let Config::Show { flags } = config;
    match file() {
        Some(path) if path.exists() => say!("{:<20}{}", "file", path.display()),
        Some(path) => say!("{:<20}{} (does not exist)", "file", path.display()),
        None => say!("{:<20}none: neither XDG_CONFIG_HOME nor HOME is set", "file"),
    }
    let words = ["lightskin".into(), "view".into()].into_iter().chain(flags.iter().cloned());
    let matches = match grammar()?.try_get_matches_from(words) {
        Ok(matches) => matches,
        Err(error) => error.exit(),
    };
    let Some((_, view)) = matches.subcommand() else { return Ok(()) };
    let in_file: Vec<String> = settings()?.into_iter().map(|(name, _)| name).collect();
    for name in names() {
        let id = name.replace('-', "_");
        let value = view
            .try_get_raw(&id)
            .ok()
            .flatten()
            .map(|values| values.map(|value| value.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" "));
        let origin = match view.value_source(&id) {
            Some(ValueSource::CommandLine) => "command line".to_owned(),
            Some(ValueSource::EnvVariable) => variable(&name),
            _ if in_file.contains(&name) => "file".to_owned(),
            _ => "default".to_owned(),
        };
        say!("{name:<20}{:<24}{origin}", value.unwrap_or_else(|| "-".into()));
    }
    Ok(())
}

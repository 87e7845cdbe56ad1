//! `demand`: a scenario with vehicles whose routes fit traffic counts.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde_json::json;

use super::listing::Listing;
use crate::cli::DemandArgs;
use dials_core::base::counted;
use dials_core::outside::{path_as_text, quoted, write_together};
use dials_session::error::{Error, Result as CommandResult};
use dials_session::outputs::{check_free, check_not_of_a_run, check_writable};
use dials_session::places::{Existing, clear};
use dials_session::terminal::{answer, json as in_json, program};
use dials_traffic::config::sumocfg::{self, Sumocfg};
use dials_traffic::counts::{CountedDemand, Fitted, GOOD_GEH, demand as demand_of};

const ROUTES: &str = "demand.rou.xml";
const CONFIG: &str = "demand.sumocfg";
/// Number of counts that are shown: those that fit worst.
const SHOWN: usize = 10;

pub(super) fn demand(args: &DemandArgs) -> CommandResult<()> {
    let (found, files) = make(args).map_err(Error::Usage)?;
    answer(if args.json { as_json(&found, &files) } else { as_text(&found, &files) }).map_err(Error::Run)
}

fn make(args: &DemandArgs) -> Result<(CountedDemand, [PathBuf; 2])> {
    let files = [ROUTES, CONFIG].map(|name| args.out.join(name));
    let existing = Existing::of_named(args.force);
    check_not_of_a_run("--out", &args.out)?;
    files.iter().try_for_each(|file| check_free(file, "--out", existing))?;
    let net = match Sumocfg::is_one(&args.net) {
        true => Sumocfg::read(&args.net)?.net,
        false => args.net.clone(),
    };
    let found = demand_of(&args.counts, &net)?;
    check_writable(&args.out)?;
    let (begin_s, end_s) = found.window_s;
    let config = sumocfg::text(&relative(&args.out, &net)?, &[ROUTES.into()], &[], [begin_s, end_s], &[])?;
    files.iter().try_for_each(|file| clear(file, existing))?;
    let [routes, scenario] = files.clone();
    write_together(&args.out, &[(routes, found.routes.clone().into_bytes()), (scenario, config.into_bytes())])?;
    Ok((found, files))
}

/// Returns the path of a file as seen from a folder.
fn relative(folder: &Path, file: &Path) -> Result<PathBuf> {
    let whole = |path: &Path| fs::canonicalize(path).with_context(|| format!("{}: cannot be found", path.display()));
    let (folder, file) = (whole(folder)?, whole(file)?);
    let shared = folder.components().zip(file.components()).take_while(|(one, other)| one == other).count();
    let up = folder.components().skip(shared).map(|_| Path::new(".."));
    Ok(up.chain(file.components().skip(shared).map(|part| Path::new(part.as_os_str()))).collect())
}

/// Returns the counts, the one that fits worst first.
fn worst_first(found: &CountedDemand) -> Vec<&Fitted> {
    let mut counts: Vec<&Fitted> = found.counts.iter().collect();
    counts.sort_by(|one, other| other.geh.total_cmp(&one.geh));
    counts
}

fn as_text(found: &CountedDemand, [routes, config]: &[PathBuf; 2]) -> String {
    let mut text = Listing::default();
    let good = found.counts.iter().filter(|count| count.geh < GOOD_GEH).count();
    let (cars, ways) = (counted(found.cars, "car"), counted(found.ways, "route"));
    text.paragraph(format_args!("wrote {}: {cars} on {ways}", routes.display()));
    text.paragraph(format_args!(
        "{good} of {} have a GEH below {GOOD_GEH} ({:.0} %; 85 % is the usual demand on a model)",
        counted(found.counts.len(), "count"),
        100.0 * good as f64 / found.counts.len() as f64
    ));
    let worst: Vec<&Fitted> = worst_first(found).into_iter().filter(|count| count.geh >= 0.005).take(SHOWN).collect();
    if !worst.is_empty() {
        text.line("\nthe counts that fit worst:");
        let head = ["from", "to", "begin s", "counted", "made", "GEH"].map(str::to_owned);
        let rows = worst.into_iter().map(|count| {
            let Fitted { from, to, begin_s, counted, made, geh, .. } = count;
            [from.clone(), to.clone(), begin_s.to_string(), counted.to_string(), made.to_string(), format!("{geh:.2}")]
        });
        text.table([head].into_iter().chain(rows).collect());
    }
    text.line(format_args!("\nplay it with: {} baseline {} --compare program,max-pressure", program(), quoted(config)));
    text.finish()
}

fn as_json(found: &CountedDemand, [routes, config]: &[PathBuf; 2]) -> String {
    let counts = found.counts.iter().map(|count| {
        let Fitted { begin_s, end_s, from, to, counted, made, geh } = count;
        json!({ "begin_s": begin_s, "end_s": end_s, "from": from, "to": to, "counted": counted, "made": made, "geh": geh })
    });
    in_json(json!({
        "routes": path_as_text(routes),
        "config": path_as_text(config),
        "cars": found.cars,
        "ways": found.ways,
        "counts": counts.collect::<Vec<_>>(),
    }))
}

//! Keeps BLAS to one thread for `bench`, which times libtorch.

use std::os::unix::process::CommandExt;

use dials_session::terminal::note;

/// Makes sure that libtorch's BLAS runs in one thread.
///
/// The libraries read two variables when they are loaded, which is before `main`. If the variables are not set, the
/// process starts itself again with them. Nothing else in this program computes with BLAS.
pub(super) fn keep_to_one_thread() {
    const THREADS: [&str; 2] = ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"];
    if THREADS.iter().any(|name| std::env::var_os(name).is_none_or(|value| value != "1")) {
        let mut again = std::process::Command::new("/proc/self/exe");
        let mut typed = std::env::args_os();
        // Keep the name under which the program was called, for help and for `run.json`.
        if let Some(name) = typed.next() {
            again.arg0(name);
        }
        again.args(typed).envs(THREADS.map(|name| (name, "1")));
        let error = again.exec();
        note(format_args!(
            "warning: could not restart with one BLAS thread ({error}); libtorch's peak may be that of several cores"
        ));
    }
}

//! BLAS in one thread, for `bench`, which times libtorch.

use std::os::unix::process::CommandExt;

use crate::terminal::tell;

/// Makes sure that libtorch's BLAS runs in one thread. The libraries read these variables when they are loaded, which is
/// before `main`; so where they are not set, the process starts itself again with them.
///
/// For those who time it. Nothing else of this program computes with BLAS.
pub fn keep_to_one_thread() {
    const THREADS: [&str; 2] = ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"];
    if THREADS.iter().any(|name| std::env::var_os(name).is_none_or(|value| value != "1")) {
        let mut again = std::process::Command::new("/proc/self/exe");
        let mut typed = std::env::args_os();
        // The name under which it was called stays, for help and for `run.json`.
        if let Some(name) = typed.next() {
            again.arg0(name);
        }
        again.args(typed).envs(THREADS.map(|name| (name, "1")));
        let error = again.exec();
        tell(format_args!(
            "warning: could not restart with one BLAS thread ({error}); libtorch's peak may be that of several cores"
        ));
    }
}

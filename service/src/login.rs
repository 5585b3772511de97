//! Whether systemd-logind will remove the service's shared memory when its user logs out.
//!
//! logind removes the shared memory of a user who is not a system user when the user's last session ends (`RemoveIPC=`
//! in logind.conf, on by default), unless the user lingers.

use std::fs;
use std::path::Path;

/// The highest number of system users unless the system was built otherwise.
const MAX_SYSTEM_USER: u32 = 999;

/// A warning, if shared memory of this process's user is removed at a logout.
pub(crate) fn warning() -> Option<String> {
    let user = rustix::process::geteuid().as_raw();
    let name = removes_memory_of(user, Path::new("/"))?;
    Some(format!(
        "systemd-logind removes the shared memory of {name} when {name} logs out, and the service has to restart \
         then: run it as a system service, or keep the user's session with `loginctl enable-linger {name}`"
    ))
}

/// The name of the user if logind, in the system below `root`, removes the memory at a logout.
fn removes_memory_of(user: u32, root: &Path) -> Option<String> {
    if user <= MAX_SYSTEM_USER || !root.join("run/systemd/system").is_dir() {
        return None;
    }
    // logind describes each user who is logged in.
    let text = fs::read_to_string(root.join(format!("run/systemd/users/{user}"))).ok()?;
    let name = text.lines().find_map(|line| line.strip_prefix("NAME="))?.trim_matches('"').to_owned();
    let lingers = root.join("var/lib/systemd/linger").join(&name).exists();
    (!lingers && removes_ipc(root)).then_some(name)
}

/// The last `RemoveIPC=` that logind reads decides.
fn removes_ipc(root: &Path) -> bool {
    let folders = ["usr/lib/systemd/logind.conf.d", "run/systemd/logind.conf.d", "etc/systemd/logind.conf.d"];
    let mut drop_ins: Vec<_> = folders
        .into_iter()
        .flat_map(|folder| fs::read_dir(root.join(folder)).into_iter().flatten().flatten())
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "conf"))
        .collect();
    drop_ins.sort_by_key(|path| path.file_name().map(ToOwned::to_owned));
    let files = [root.join("usr/lib/systemd/logind.conf"), root.join("etc/systemd/logind.conf")];
    let texts = files.into_iter().chain(drop_ins).filter_map(|path| fs::read_to_string(path).ok());
    let value = |text: String| {
        let values = text.lines().filter_map(|line| line.trim().strip_prefix("RemoveIPC="));
        values.map(|value| value.trim().to_ascii_lowercase()).next_back()
    };
    let last = texts.filter_map(value).next_back();
    !last.is_some_and(|value| ["no", "false", "off", "0", "n", "f"].contains(&value.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_login_user_without_linger_is_warned() {
        let root = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let removes = |user: u32| removes_memory_of(user, root.path());
        write("run/systemd/users/1000", "UID=1000\nNAME=navigator\nSTATE=active\n");
        assert_eq!(removes(1000), None, "no systemd");
        write("run/systemd/system/x", "");
        assert_eq!(removes(1000).as_deref(), Some("navigator"));
        assert_eq!((removes(1001), removes(970)), (None, None));
        write("etc/systemd/logind.conf", "[Login]\n#RemoveIPC=no\nRemoveIPC=no\n");
        assert_eq!(removes(1000), None);
        write("etc/systemd/logind.conf.d/50.conf", "[Login]\nRemoveIPC=yes\n");
        assert_eq!(removes(1000).as_deref(), Some("navigator"));
        write("var/lib/systemd/linger/navigator", "");
        assert_eq!(removes(1000), None);
    }
}

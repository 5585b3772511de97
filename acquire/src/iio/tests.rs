//! Tests on trees of files that stand for sysfs, with pipes as device nodes.

mod faults;
mod formats;
mod joining;
mod listing;
mod naming;
mod rates;
mod records;
mod setting_up;
mod streams;
mod temperatures;
mod tree;

# Adds the column `lagged` to a recording: the temperature `column` behind a lag of `tau` seconds, by the formula of
# temperature-in-motion.md.
#   awk -F, -v tau=240 -v column=a1_head -f lagged.awk ramp.csv > lagged.csv
# Each row counts as a reading, at its timestamp_ns.
NR == 1 {
    for (i = 1; i <= NF; i++) index_of[$i] = i
    if (!(tau > 0) || !(column in index_of) || !("timestamp_ns" in index_of)) {
        print "lagged.awk: give -v tau=SECONDS and -v column=NAME; the file needs this column and timestamp_ns" > "/dev/stderr"
        exit 1
    }
    print $0 ",lagged"
    next
}
{
    t = $index_of["timestamp_ns"] / 1e9; u = $index_of[column]
    if (NR == 2) lagged = u
    else { a = exp(-(t - t_last) / tau); lagged = u + (lagged - u_last) * a - (u - u_last) * (1 - a) * tau / (t - t_last) }
    t_last = t; u_last = u
    printf "%s,%.7f\n", $0, lagged
}

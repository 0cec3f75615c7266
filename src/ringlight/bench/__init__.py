"""Speed, measured: medians of interleaved rounds, wall and CPU time, beside what the machine can do at best."""

"""From a recording and its source file to a trial: units, signs, clocks, force plates; and what is
measured of a recording's quality. Bytes are read in `formats`, limits are known to `judge`."""

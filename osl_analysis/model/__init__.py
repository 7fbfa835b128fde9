"""The drivetrain of Section II and the compensator of Section III, in the paper's symbols."""

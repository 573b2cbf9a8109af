"""What each method would cost and answer, told from a sample before anything is run."""

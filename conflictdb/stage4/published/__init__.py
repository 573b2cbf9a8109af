"""The method `nlp`: the published linear and nonlinear programs."""

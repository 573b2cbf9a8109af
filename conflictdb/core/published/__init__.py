"""The published algorithms of stages 3 and 4, for method `nlp`: projection, linear and nonlinear programs."""

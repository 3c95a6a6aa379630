"""Data: tables of what was answered, Psych-DS, files brought in, sessions taken out."""

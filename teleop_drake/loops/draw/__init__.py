"""Pictures of Diagrams and of models between ports."""

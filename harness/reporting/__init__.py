"""What every report needs: blocks of content, layout, colours and number formats."""
